"""Proposes a column map for a file without standard column names, from words, numbers and units in its names.

The proposal is only shown to the user. It is never used to read a file, because it may be wrong.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import cast

from identification.data.readers.contract_columns import UNITS, Quantity

_WORDS: dict[Quantity, frozenset[str]] = {
    "t": frozenset("t time timestamp stamp sec secs second seconds".split()),
    "tau": frozenset("tau torque torques effort efforts eff force forces load loads moment qfrc trq tq".split()),
    "i": frozenset("i current currents cur amps amperes".split()),
    "u": frozenset("u voltage voltages volt volts".split()),
    "v": frozenset("v dq qd qdot vel velocity velocities speed speeds qvel jvel omega".split()),
    "q": frozenset("q pos position positions angle angles theta qpos jpos encoder enc".split()),
}
_COMMANDED = frozenset("ref reference target cmd command commanded desired des goal action setpoint sp ctrl".split())
_PLAIN = frozenset("actual measured meas state observation joint joints motor actuator axis feedback fb".split())
"""Words that do not show which quantity a column has."""
_UNITS = {
    "degree": "deg",
    "degrees": "deg",
    "nm": "Nm",
    "mnm": "mNm",
    "nmm": "Nmm",
    "ncm": "Ncm",
    "ma": "mA",
    "mv": "mV",
}
_UNITS |= {unit: unit for unit in "ms us ns deg rev mm um rpm".split()}
"""Units as they are written in column names, with their spelling in a column map."""


def suggested_map(names: Sequence[str], joints: Sequence[str]) -> str:
    """A proposed column map for these columns and the joints of a robot; empty if too little is recognised.

    Args:
        names: Columns of the file.
        joints: Joint names of the robot; numbered columns are assigned to them in order.

    Returns:
        YAML with one entry per line; columns with a standard name need no entry. Comments ask for each position that
        was not recognised, and for torques if neither torques nor references were recognised. A comment also lists a
        numbered column beyond the last joint.
    """
    found: dict[tuple[Quantity, str], str] = {}
    numbered: dict[Quantity, dict[int, str]] = {}
    for name in names:
        joint, words = _without_joint(_parts(name), joints)
        quantity = _quantity([word for word in words if not _is_number(word)], bool(joint))
        numbers = [int(word) for word in words if _is_number(word)]
        if quantity is None:
            continue
        if quantity == "t" or joint or (len(joints) == 1 and not numbers):
            found.setdefault((quantity, "" if quantity == "t" else joint or joints[0]), name)
        elif len(numbers) == 1:
            numbered.setdefault(quantity, {}).setdefault(numbers[0], name)
    beyond: list[str] = []
    # An arm's log may have one more column, for the gripper. With more columns the assignment is not clear.
    most_columns = len(joints) + (1 if len(joints) > 1 else 0)
    for quantity, columns in numbered.items():
        if len(joints) <= len(columns) <= most_columns:
            in_order = [columns[number] for number in sorted(columns)]
            for joint, name in zip(joints, in_order, strict=False):
                found.setdefault((quantity, joint), name)
            beyond += in_order[len(joints) :] if quantity == "q" else []
    if ("t", "") not in found or not any(quantity == "q" for quantity, _ in found):
        return ""
    unassigned = [f"# {name}: of no joint of the robot (a gripper?)" for name in beyond]
    return "\n".join([*_lines(found, joints), *unassigned])


def _lines(found: dict[tuple[Quantity, str], str], joints: Sequence[str]) -> list[str]:
    """Lines of the proposed map, from the column of each quantity and joint."""
    lines = [] if found["t", ""] == "t" else [f"t: {_source('t', found['t', ''])}"]
    # If torques are recorded, currents and voltages are not needed.
    torque = next((one for one in ("tau", "i", "u") if any((one, joint) in found for joint in joints)), "tau")
    for quantity in cast("tuple[Quantity, ...]", ("q", torque, "q_ref")):
        for joint in joints:
            name = found.get((quantity, joint))
            if name is not None and name != f"{quantity}.{joint}":
                lines.append(f"{quantity}.{joint}: {_source(quantity, name)}")
            elif name is None and quantity == "q":
                lines.append(f"# q.{joint}: which column?")
    if not any((one, joint) in found for one in (torque, "q_ref") for joint in joints):
        lines.append("# tau.<joint>: which columns hold torques (or i.<joint> motor currents, u.<joint> voltages)?")
    return lines


def _source(quantity: Quantity, name: str) -> str:
    """Value of an entry: the column's name, with a unit if the name contains one that is not the SI unit."""
    unit = next((_UNITS[word] for word in _parts(name) if word in _UNITS), None)
    column = quoted(name)
    return f"{{from: {column}, unit: {unit}}}" if unit and UNITS[quantity].get(unit, 1.0) != 1.0 else column


def quoted(name: str) -> str:
    """A column's name in YAML, in quotes if YAML needs them."""
    if re.fullmatch(r"[A-Za-z_][\w.]*", name):
        return name
    return '"' + name.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _parts(name: str) -> list[str]:
    """Words and numbers of a name in lower case: ``jointPos_1`` gives joint, pos and 1; ``mNm`` is one word."""
    out = []
    for run in re.findall(r"[A-Za-z]+|\d+", name):
        words = [run] if run.lower() in _UNITS else re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+", run)
        out += [word.lower() for word in words]
    return out


def _is_number(word: str) -> bool:
    """True if a word may be the number of a joint: at most six ASCII digits, as longer numbers are serial numbers."""
    return word.isascii() and word.isdigit() and len(word) < 7


def _without_joint(words: list[str], joints: Sequence[str]) -> tuple[str, list[str]]:
    """The joint whose name a column's name contains (the longest if there are several), and the remaining words."""
    best, remaining = "", words
    most = 0
    for joint in joints:
        parts = _parts(joint)
        for part in (parts, [word for word in parts if word != "joint"]):
            at = next((k for k in range(len(words)) if part and words[k : k + len(part)] == part), None)
            if at is not None and len(part) > most and not all(word.isdigit() for word in part):
                best, most, remaining = joint, len(part), words[:at] + words[at + len(part) :]
    return best, remaining


def _quantity(words: list[str], has_joint: bool) -> Quantity | None:
    """Quantity of a column from the words of its name; None if it is not recognised."""
    meaningful = {word for word in words if word not in _UNITS}
    commanded = bool(meaningful & _COMMANDED)
    for quantity, words_of_quantity in _WORDS.items():
        if meaningful & words_of_quantity:
            if quantity == "q":
                return "q_ref" if commanded else "q"
            # A commanded torque or speed is not a measured one.
            return None if commanded else quantity
    if has_joint and meaningful <= _PLAIN | _COMMANDED:
        return "q_ref" if commanded else "q"
    return None
