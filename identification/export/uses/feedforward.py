# pyright: reportAttributeAccessIssue=false
"""Writes the feedforward torque of the corrected model as plain Python without dependencies, and as a table.

The inverse dynamics in ``feedforward_functions.txt`` repeat `phantom_dyn.dynamics.dynamics`, because users copy the
written file into a controller, where it must not need other code.
"""

from __future__ import annotations

import csv
import io
from pathlib import Path
from pprint import pformat
from typing import Any

import numpy as np
import pinocchio as pin

from identification.csv_cells import text_cell
from identification.diagnosis.result import Diagnosis
from identification.export.corrected.corrected_model import CorrectedModel, torque_limits
from identification.export.file_names import FEEDFORWARD
from identification.export.model_files.tree import bodies
from phantom_dyn import __version__
from phantom_dyn.array_types import Array, Float, read_only
from phantom_dyn.dynamics.tree_motion import tree_friction
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.errors import ParameterError
from phantom_dyn.loops.solver import tree_positions
from phantom_dyn.model.robot import Robot

_POSITIONS, _SPEEDS = 91, 20  # number of positions of a joint in the table, and of speeds in each direction
_JOINT_ROWS = _POSITIONS + 2 * _SPEEDS + 1  # rows of one joint: positions, speeds in both directions, and speed zero
OWN_LAWS = ("direction_dependent_friction", "stribeck_friction", "load_dependent_friction", "encoder_eccentricity")
"""Effects of `CorrectedModel.others` for which the file has a formula of its own."""
_MOST = 2.0
"""The file refuses motions that need more than this multiple of the largest measured torque."""
COLUMNS = ("over", "joint", "q", "v", "gravity", "friction", "cogging", "command", "headroom", "run")


def feedforward_code(corrected: CorrectedModel, diagnosis: Diagnosis) -> str:
    """The text of ``feedforward.py``.

    Args:
        corrected: The corrected model.
        diagnosis: The diagnosis, with the largest measured torques.

    Raises:
        ParameterError: If the robot has numerically solved loops.
    """
    functions = Path(__file__).with_name("feedforward_functions.txt").read_text(encoding="utf-8")
    imports, _, functions = functions.partition("import math\n")
    values = _constants(corrected) | {"MEASURED": _measured(diagnosis, corrected.robot.nv), "MOST": _MOST}
    constants = "".join(f"{name} = {pformat(value, width=110)}\n" for name, value in values.items())
    code = f"{imports}import math\n\n{constants}{functions}"
    return f'"""{_docstring(corrected)}\n"""\n\n{code}'


def loaded(code: str, file: str = FEEDFORWARD) -> dict[str, Any]:
    """Runs a written Python file and returns the names that the file defines.

    Args:
        code: Text of the file.
        file: Name of the file.
    """
    names: dict[str, Any] = {"__name__": Path(file).stem}
    exec(compile(code, file, "exec"), names)
    return names


def over_samples(code: str) -> dict[str, Any]:
    """The names that a ``feedforward.py`` defines, with functions that accept arrays of N samples instead of numbers.

    The functions of the file use only sums, products and functions of ``math`` that NumPy has under the same names, so
    ``math`` is replaced by NumPy. Pass read-only arrays, so that a function that changes its arguments fails.
    """
    names = loaded(code)
    names |= {"math": np, "_sign": np.sign, "_check": lambda *_: None, "_refuse": lambda _: None}
    names["_within"] = lambda x, limit: np.clip(x, -limit, limit)
    return names


def _measured(diagnosis: Diagnosis, nv: int) -> _Limits:
    """Largest measured torque of each joint, infinite if none was measured."""
    if diagnosis.replay is not None:
        largest = diagnosis.replay.largest_torque()
    else:
        largest = np.abs(diagnosis.evidence.tau_measured).max(axis=0, initial=0.0)
    return _Limits(np.where(largest > 0, largest, np.inf) if len(largest) else np.full(nv, np.inf))


def feedforward_table(corrected: CorrectedModel, diagnosis: Diagnosis, code: str) -> str:
    """The text of ``feedforward.csv``: torques of each joint over its recorded range of positions and of speeds.

    The other joints are at rest in the middle of their recorded positions.

    Args:
        corrected: The corrected model.
        diagnosis: The diagnosis, with the recorded positions and speeds.
        code: The `feedforward_code` of both.
    """
    names, law = corrected.robot.joint_names, over_samples(code)
    q, v = _table_motion(diagnosis, len(names))
    joints = np.repeat(np.arange(len(names)), _JOINT_ROWS)
    position, velocity, acceleration = _rows(q), _rows(v), _rows(0.0 * v)
    terms = (
        law["gravity"](position),
        law["friction"](position, velocity),
        law["cogging"](position),
        law["torque"](position, velocity, acceleration),
        law["headroom"](position, velocity, acceleration),
    )
    # Each row of the table has the values of one joint.
    *numbers, headroom = (
        np.broadcast_to(values, q.shape)[np.arange(len(q)), joints] for values in (q, v, *map(_series, terms))
    )
    cells = [text_cell(name) for name in names]
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(COLUMNS)
    rows = zip(joints.tolist(), np.array(numbers).T.tolist(), headroom.tolist(), strict=True)
    for k, (j, row, room) in enumerate(rows):
        over = "position" if k % _JOINT_ROWS < _POSITIONS else "velocity"
        # Without a limit of the torque the headroom is infinite, and its cell is empty.
        table.writerow([over, cells[j], *row, room if np.isfinite(room) else "", diagnosis.run])
    return text.getvalue()


def _table_motion(diagnosis: Diagnosis, nv: int) -> tuple[Float[Array, "N nv"], Float[Array, "N nv"]]:
    """Positions and velocities of the table's rows: for each joint first all positions at rest, then all velocities."""
    q, v = diagnosis.evidence.q, diagnosis.evidence.v
    low, high = (q.min(axis=0), q.max(axis=0)) if len(q) else (np.zeros(nv), np.zeros(nv))
    fastest = np.abs(v).max(axis=0) if len(v) else np.zeros(nv)
    positions = np.tile(0.5 * (low + high), (nv, _JOINT_ROWS, 1))
    velocities = np.zeros_like(positions)
    for j in range(nv):
        positions[j, :_POSITIONS, j] = np.linspace(low[j], high[j], _POSITIONS)
        speeds = fastest[j] * np.geomspace(1e-3, 1.0, _SPEEDS)
        velocities[j, _POSITIONS:, j] = [*-speeds[::-1], 0.0, *speeds]
    return positions.reshape(-1, nv), velocities.reshape(-1, nv)


def _rows(values: Float[Array, "N nv"]) -> list[Float[Array, " N"]]:
    """The columns of ``values``: one read-only array for each joint."""
    return [read_only(row) for row in values.T]


def _series(values: list[Float[Array, " N"] | float]) -> Float[Array, "N nv"] | Float[Array, " nv"]:
    """Values of each joint as one array; without the dimension of samples if all values are constants."""
    return np.stack(np.broadcast_arrays(*values), axis=-1)


def _constants(corrected: CorrectedModel) -> dict[str, object]:
    """Constants of the file by name: parameters of the corrected model."""
    robot = corrected.robot
    slope, start = _linear_loops(robot)
    row = {joint: k for k, joint in enumerate(robot.joint_names)}
    viscous, coulomb = tree_friction(robot)
    laws: dict[str, list[tuple]] = {}
    for effect in corrected.others:
        laws.setdefault(effect.effect, []).append((row[str(effect.joint)], *effect.theta))
    two_way, stribeck, by_load, eccentric = (laws.get(name, []) for name in OWN_LAWS)
    leads = [corrected.delays.get(joint, 0.0) + corrected.lags.get(joint, 0.0) for joint in robot.joint_names]
    return {
        "JOINTS": robot.joint_names,
        "LEAD": tuple(leads),
        "GAINS": tuple(corrected.gains.get(joint, 1.0) for joint in robot.joint_names),
        "LIMITS": _Limits(torque_limits(corrected).get(joint, np.inf) for joint in robot.joint_names),
        "GRAVITY": _plain(robot.model.gravity.linear),
        "BODIES": _bodies(robot),
        "SLOPE": _plain(slope),
        "START": _plain(start),
        "ROTORS": _plain(robot.model.armature),
        "VISCOUS": _plain(viscous),
        "COULOMB": _plain(coulomb),
        "TWO_WAY": {law[0]: 0.5 * (law[3] - law[4]) for law in two_way},
        "STRIBECK": tuple((law[0], law[2] - law[1], law[3]) for law in stribeck),
        "LOADED": tuple((law[0], law[1]) for law in by_load),
        "COUPLINGS": tuple(
            (row[c.first], row[c.second], c.ratio, c.coulomb_torque, c.coefficient, c.inertia)
            for c in corrected.couplings
        ),
        "COGGING": tuple((row[joint], *wave) for joint, waves in corrected.cogging.items() for wave in waves),
        "OFFSETS": {row[joint]: value for joint, value in corrected.offsets.items()},
        "SPRINGS": {row[joint]: value for joint, value in corrected.springs.items()},
        "ZEROS": {row[joint]: value for joint, value in corrected.zeros.items()},
        "ECCENTRIC": {law[0]: law[1:] for law in eccentric},
    }


class _Limits(tuple):
    """A tuple of numbers whose ``repr`` is valid Python code also for infinite numbers."""

    def __repr__(self) -> str:
        words = [repr(float(x)) if np.isfinite(x) else "math.inf" for x in self]
        return f"({', '.join(words)},)"


def _plain(values: Float[Array, "..."]) -> tuple:
    """An array as nested tuples."""
    return tuple(float(x) if np.ndim(x) == 0 else _plain(x) for x in np.asarray(values))


def _bodies(robot: Robot) -> tuple:
    """Parent, kind, placement, axis and inertia about the joint of every body."""
    out = []
    for body in bodies(robot):
        whole = pin.Inertia(body.inertia.mass, np.array(body.inertia.center), np.array(body.inertia.inertia))
        about = whole.matrix()[3:, 3:]
        moment = body.inertia.mass * body.inertia.center
        place = _plain(body.rotation), _plain(body.position), _plain(body.axis)
        out.append((body.parent, body.prismatic, *place, float(body.inertia.mass), _plain(moment), _plain(about)))
    return tuple(out)


def _linear_loops(robot: Robot) -> tuple[Float[Array, "nt nv"], Float[Array, " nt"]]:
    """Slopes and offsets of the positions of all joints as a linear function of the driven joints' positions."""
    if robot.chain is None:
        return np.eye(robot.nv), np.zeros(robot.nv)
    if robot.chain.anchors:
        raise ParameterError(
            f"{robot.name} has loops that keep two frames together, which need a solver: load the corrected file "
            "and call phantom_dyn.dynamics.dynamics.inverse_dynamics in the controller instead."
        )
    positions = np.vstack([np.zeros((1, robot.nv)), np.eye(robot.nv)])
    tree = tree_positions(robot.model, robot.chain, positions, arrays=robot.arrays)
    return (tree[1:] - tree[0]).T, tree[0]


def _docstring(corrected: CorrectedModel) -> str:
    """The docstring of the file: its use, and the effects that it lacks."""
    robot = corrected.robot
    names = robot.joint_names
    lines = [
        f"Feedforward torque of {robot.name}, made by phantom-dyn {__version__} from a diagnosis. Needs only Python.",
        "",
        f"torque(q, v, a) takes the wanted motion, one number for each joint ({', '.join(names)}), and returns the",
        "torque to command to the drives [N m or N]. gravity, friction and cogging (with constant torques and springs)",
        "return parts of it, and headroom what is left of the limits. If LEAD is not zero, the drive is late: pass the",
        "motion that is wanted this number of seconds later.",
        "",
        "torque never exceeds LIMITS. A motion that needs more than MOST times the largest MEASURED torque raises a",
        "ValueError.",
    ]
    missing = _missing(corrected)
    if missing:
        lines += ["", f"Not in it: {'; '.join(missing)}."]
    return "\n".join(lines).replace("\\", "/").replace('"""', "'''")


def _missing(corrected: CorrectedModel) -> list[str]:
    """Names of the effects of the corrected model that the file lacks."""
    words = (
        (effect_named(e.effect, corrected.given).words, e.joint) for e in corrected.others if e.effect not in OWN_LAWS
    )
    out = [f"{effect_words.lost or effect_words.name} ({joint})" for effect_words, joint in words]
    out += [f"play ({joint})" for joint in corrected.plays]
    return out + [f"springs of transmissions ({joint})" for joint in corrected.compliances]
