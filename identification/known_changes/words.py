"""Changes between recordings in words."""

from __future__ import annotations

from identification.diagnosis.numbers import value_words
from identification.diagnosis.result import Finding


def in_recording(recording: str | None) -> str:
    """``in b.csv`` with a space before it; nothing for what all recordings have."""
    return "" if recording is None else f" in {recording}"


def growth_words(finding: Finding) -> str:
    """``, where it is 2.1 times what it is in the other recordings``; nothing where that is not known."""
    ratio = (
        None if finding.effect in ("torque_constant", "load_dependent_friction") else finding.parameters.get("ratio")
    )
    if finding.recording is None or ratio is None:
        return ""
    return f", where it is {value_words(ratio)} times what it is in the other recordings"
