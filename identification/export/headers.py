"""What a written file leaves of the recorded torque, as a table in its own header."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from identification.diagnosis.result import Diagnosis, WrittenFile
from identification.words.numbers_and_names import number

_OF_DRIVES = "feedforward.py"


def with_header(text: str, record: WrittenFile, diagnosis: Diagnosis) -> str:
    """The text of a file with what it leaves of each joint in its header; as it is where nothing was run.

    Args:
        text: Of the file.
        record: What it leaves.
        diagnosis: Gives units and the measured torque.
    """
    if not record.rms_left:
        return text
    lines = _table(record, diagnosis)
    kind = Path(record.file).suffix
    if kind == ".yaml":
        return "".join(f"# {line}\n" for line in lines) + text
    if kind == ".py":
        end = text.index('"""', 3)
        own = "\n".join(lines).replace("\\", "/").replace('"""', "'''")
        return f"{text[:end].rstrip()}\n\n{own}\n{text[end:]}"
    return with_comment(text, lines)


def with_comment(text: str, lines: Sequence[str]) -> str:
    """The text of a URDF or MJCF with a comment behind the start of its root element.

    Args:
        text: Of the file.
        lines: Of the comment.
    """
    # A comment may not hold two dashes.
    comment = "\n    ".join(line.replace("--", "- -") for line in lines)
    start = text.index(">", text.index("<mujoco" if "<mujoco" in text else "<robot")) + 1
    return f"{text[:start]}\n  <!-- {comment}\n  -->{text[start:]}"


def _table(record: WrittenFile, diagnosis: Diagnosis) -> list[str]:
    low, high = diagnosis.band_hz
    columns: list[tuple[str, Mapping[str, float | None]]] = [
        ("given model", record.rms_given),
        ("this file", record.rms_left),
    ]
    if record.file == _OF_DRIVES:
        columns.insert(0, ("no feedforward", {joint.joint: joint.rms_torque for joint in diagnosis.joints}))
    names = [joint.joint for joint in diagnosis.joints]
    width = max(20, *(len(name) for name in names))
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
