"""Writes the header of an exported file: a table with the root mean square residual torque of each joint."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from identification.diagnosis.result import Diagnosis, FittedNumbers
from identification.diagnosis.written import WrittenFile
from identification.export.file_names import FEEDFORWARD, YAML
from identification.words.numbers_and_names import number
from phantom_dyn.errors import listed

_LATE = 0.05  # delays below this number of samples hardly change the residuals and are not mentioned


def with_header(text: str, record: WrittenFile, diagnosis: Diagnosis, fitted: FittedNumbers) -> str:
    """Adds a header with the file's residual on each joint to the text of a file, if the file was checked.

    Args:
        text: Text of the file.
        record: Result of checking the file, with the residuals.
        diagnosis: The diagnosis, with units and the measured torque.
        fitted: Numbers of the fit, with the delays of the recorded torque and references.
    """
    if not record.rms_left:
        return text
    lines = _table(record, diagnosis)
    if abs(fitted.timing) > _LATE:
        shift = f"{'late' if fitted.timing < 0 else 'early'} by {abs(fitted.timing):.2f} samples"
        lines.append(f"The recorded torque is {shift}. These figures include the shift and no file does.")
    shifted = [joint for joint, part in fitted.arrivals if abs(part) > _LATE]
    if shifted:
        lines.append(
            f"The voltage of {listed(shifted)} was read at one time while each reference was held, and is not the "
            "mean over it. These figures include the difference and no file does."
        )
    if record.file == YAML:
        lines.append("These figures include the changes under adjusted; --with does not apply them.")
    kind = Path(record.file).suffix
    if kind == ".yaml":
        return "".join(f"# {line}\n" for line in lines) + text
    if kind == ".py":
        end = text.index('"""', 3)
        own = "\n".join(lines).replace("\\", "/").replace('"""', "'''")
        return f"{text[:end].rstrip()}\n\n{own}\n{text[end:]}"
    return with_comment(text, lines)


def with_comment(text: str, lines: Sequence[str]) -> str:
    """Adds a comment to a URDF or MJCF, after the start tag of the root element.

    Args:
        text: Text of the file.
        lines: Lines of the comment.
    """
    # A comment must not contain two dashes, nor end with one.
    comment = "\n    ".join(re.sub("-(?=-)", "- ", line) for line in lines)
    start = text.index(">", root_start(text)) + 1
    return f"{text[:start]}\n  <!-- {comment}\n  -->{text[start:]}"


def root_start(text: str) -> int:
    """Index in a URDF or MJCF at which the root element begins; comments before the root are skipped."""
    found = re.search(
        r"<(?:robot|mujoco)\b", re.sub(r"<!--.*?-->", lambda part: " " * len(part[0]), text, flags=re.DOTALL)
    )
    return 0 if found is None else found.start()


def _table(record: WrittenFile, diagnosis: Diagnosis) -> list[str]:
    """Lines of the table: residual torque of each joint with the given model and with the file."""
    low, high = diagnosis.band_hz
    columns: list[tuple[str, Mapping[str, float | None]]] = [
        ("given model", record.rms_given),
        ("this file", record.rms_left),
    ]
    if record.file == FEEDFORWARD:
        columns.insert(0, ("no feedforward", {joint.joint: joint.rms_torque for joint in diagnosis.joints}))
    width = max(20, *(len(joint.joint) for joint in diagnosis.joints))
    lines = [
        "Measured less modelled torque over the recordings, root mean square, from "
        f"{number(low)} to {number(high)} Hz, with this file loaded back:",
        f"{'joint':{width}s}" + "".join(f" {name:>15s}" for name, _ in columns),
    ]
    for joint in diagnosis.joints:
        cells = [values.get(joint.joint) for _, values in columns]
        shown = [math.nan if cell is None else float(cell) for cell in cells]
        lines.append(f"{joint.joint:{width}s}" + "".join(f" {cell:15.4g}" for cell in shown) + f" {joint.unit}")
    return lines
