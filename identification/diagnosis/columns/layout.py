"""Lists the terms that the search tries (effects with shapes, on joints or sets of joints), and orders their columns.

One cause may act on several joints with one common parameter: drives of one kind, one supply, one wrong current scale.
Sets of such joints are guessed from the drives in the robot's file, and from the scale of each joint, the ratio of its
measured to its modelled torque. If joints are sorted by scale, joints with a common cause are neighbours, so few sets
are tried.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Hashable
from dataclasses import dataclass, replace

import numpy as np

from identification.diagnosis.columns.one_recording_effects import OneRecordingEffect
from identification.diagnosis.columns.session import Session
from identification.diagnosis.columns.terms import SERIES, FoundEffect, Term, shapes_of
from phantom_dyn.array_types import Array, Float
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.rival import Rival, Shape
from phantom_dyn.model.robot import Robot

# Largest number of sets of joints that are tried; those by drives come first, those by scales last.
_MOST = 40
# Largest ratio between the scales of joints of one set; joints with a larger ratio are not tried together by scale.
_ALIKE = 1.5
# Share of a joint's largest speed below which the sign of its velocity, for dry friction, is smoothed.
_SLOW = 0.02


@dataclass(frozen=True)
class TermColumns:
    """Where the columns of one term are among all columns, for effects with columns outside the rigid-body regressor.

    Attributes:
        effect, joint, shape: Effect, joint and shape of the term.
        first: Index of the term's first column among all columns.
        count: Number of columns.
        rows: Indices of the joints on which the columns are not zero.
    """

    effect: Rival
    joint: str | None
    shape: Shape
    first: int
    count: int
    rows: tuple[int, ...]


def lay_out(
    session: Session,
    operation: Operation,
    first_body: int,
    names: list[str],
    found: tuple[FoundEffect, ...],
    resonances: tuple[FoundEffect, ...],
) -> tuple[tuple[Term, ...], tuple[TermColumns, ...]]:
    """All candidate terms, and where their columns are; the names of the columns are appended to ``names``.

    Args:
        session: Robot and recordings.
        operation: Samples of all recordings.
        first_body: Index of the first column of the rigid bodies.
        names: Names of the columns so far; the names of the effects' columns are appended.
        found: Effects of the last fit, and rivals that were nearly as good.
        resonances: Transmission compliances determined from resonances.
    """
    robot = session.robot
    terms: list[Term] = []
    term_columns: list[TermColumns] = []
    start = _first_samples(operation)
    for effect, joint, shapes in shapes_of(
        robot, operation, found, resonances, session.differences.effects, groups_of_joints(session, operation)
    ):
        if effect.inertial is not None and not isinstance(effect, OneRecordingEffect):
            columns = tuple(first_body + c for c in effect.regressor_columns(robot, joint))
            size = 4 if effect.inertial == "point mass" else len(columns)
            free = (np.inf,) * len(columns)
            terms.append(Term(effect, joint, (), columns, size, tuple(-x for x in free), free))
            continue
        for shape in shapes:
            signature = effect.signature(robot, start, joint, shape)
            count = len(signature.names)
            if count == 0:
                continue
            columns = tuple(range(len(names), len(names) + count))
            names += [f"{effect.name} {joint} {name}" for name in signature.names]
            bounds = effect.bounds_in(robot, operation, joint, shape) or ((-np.inf, np.inf),) * count
            lower, upper = zip(*bounds, strict=True)
            size = count + (0 if effect.shape_is_estimate else len(shape))
            size = 4 if effect.inertial == "point mass" else size
            terms.append(Term(effect, joint, shape, columns, size, lower, upper))
            term_columns.append(TermColumns(effect, joint, shape, columns[0], count, signature.rows))
    return tuple(terms), tuple(term_columns)


def _first_samples(operation: Operation) -> Operation:
    """The first samples, which are enough to count the columns of a signature."""
    t, q, v, a, tau, expected, logged = (getattr(operation, name)[:8] for name in SERIES)
    base = None if operation.base is None else operation.base.at(slice(8))
    few = Operation(t, q, v, a, operation.robot, tau, expected, logged, base=base)
    return few if operation.temperature is None else replace(few, temperature=operation.temperature[:8])


def groups_of_joints(session: Session, operation: Operation) -> tuple[str, ...]:
    """Sets of two or more driven joints that may have a cause in common, their names joined by ``+`` in their order.

    Args:
        session: Robot and logs.
        operation: Operation of all logs, one after the other, with the torque of the given model.
    """
    robot = session.robot
    if robot.nv < 2:
        return ()
    measured = np.concatenate([log.tau for log in session.logs])
    groups = [
        *groups_by_drives(robot),
        *groups_by_place(robot.nv),
        *groups_by_scales(scale_of_joints(measured, operation.tau, operation.v)),
    ]
    driven = [[row for row in sorted(group) if robot.actuators[row].actuated] for group in groups]
    unique = dict.fromkeys(tuple(group) for group in driven if len(group) > 1)
    return tuple("+".join(robot.joint_names[row] for row in group) for group in list(unique)[:_MOST])


def groups_by_drives(robot: Robot) -> list[tuple[int, ...]]:
    """All joints together, and sets of joints with the same torque limit, gear ratio, rotor or stem of their names."""
    out = [tuple(range(robot.nv))]
    keys: list[list[Hashable]] = [
        [one.torque_limit for one in robot.actuators],
        [one.gear_ratio for one in robot.actuators],
        [one.rotor_inertia or None for one in robot.actuators],
        [one.torque_constant for one in robot.actuators],
        [re.sub(r"\d+|joint|_", "", name) or None for name in robot.joint_names],
    ]
    for key in keys:
        alike: dict[Hashable, list[int]] = defaultdict(list)
        for row, value in enumerate(key):
            if value is not None:
                alike[value].append(row)
        out += [tuple(rows) for rows in alike.values()]
    return out


def groups_by_place(count: int) -> list[tuple[int, ...]]:
    """Sets of the first joints, and sets of the last joints: arms have large drives first and small ones last."""
    sizes = range(2, count)
    return [*(tuple(range(size)) for size in sizes), *(tuple(range(count - size, count)) for size in sizes)]


def scale_of_joints(
    measured: Float[Array, "N nv"], modelled: Float[Array, "N nv"], v: Float[Array, "N nv"]
) -> Float[Array, " nv"]:
    """Scale of measured over modelled torque of each joint, fitted together with friction and an offset, ``(nv,)``."""
    out = np.ones(measured.shape[1])
    for row in range(len(out)):
        fast = max(float(np.abs(v[:, row]).max()), 1e-12)
        columns = np.column_stack(
            [modelled[:, row], np.tanh(v[:, row] / (_SLOW * fast)), v[:, row] / fast, np.ones(len(v))]
        )
        out[row] = np.linalg.lstsq(columns, measured[:, row], rcond=1e-9)[0][0]
    return out


def groups_by_scales(scale: Float[Array, " nv"]) -> list[tuple[int, ...]]:
    """Sets of neighbours in the order of the joints' scales; sets whose scales differ least come first."""
    order = np.argsort(scale, kind="stable")
    runs = []
    for first in range(len(order)):
        for last in range(first + 1, len(order)):
            low, high = scale[order[first]], scale[order[last]]
            if low > 0.0 and high < _ALIKE * low:
                spread = float(np.log(high / low)) / (last - first)
                runs.append((spread, tuple(order[first : last + 1].tolist())))
    return [run for _, run in sorted(runs)]
