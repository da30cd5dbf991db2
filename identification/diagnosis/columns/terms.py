"""Candidate terms of the search: one effect on one joint with one shape each.

The shape of an effect is the set of parameters in which its torque is nonlinear, such as the time of a delay. The
search tries a grid of shapes. For each shape, the torque is a sum of columns times coefficients.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from identification.diagnosis.columns.structure import STRUCTURES
from phantom_dyn.array_types import Array, Float
from phantom_dyn.effects import catalogue
from phantom_dyn.effects.effect import Effect
from phantom_dyn.effects.operation import Operation, References, joined
from phantom_dyn.effects.rival import Rival, Shape
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import joined_bases

# A joint's load counts as steady if its mean is more than this many of its standard deviations. The data then do not
# separate torque that grows with the load from torque that does not.
_STEADY = 3.0

# Fields of an operation with one row for each sample.
SERIES = ("t", "q", "v", "a", "tau", "expected", "logged")


@dataclass(frozen=True)
class KnownEffect:
    """An effect that an earlier diagnosis added to the model; ``theta`` has the order of `Effect.parameters`."""

    effect: str
    joint: str | None
    theta: tuple[float, ...]


@dataclass(frozen=True)
class FoundEffect:
    """An effect of the last fit: the point about which its nonlinear law is linearised next.

    Attributes:
        effect: An effect of the catalogue, or a structure that has no name there.
        joint: Its joint, None for the whole robot.
        shape: Its shape in that fit.
        coefficients: Coefficients of its columns in that fit.
    """

    effect: Rival
    joint: str | None
    shape: Shape
    coefficients: Float[Array, " k"]

    @property
    def effect_joint(self) -> tuple[str, str | None]:
        """Name of the effect and its joint; terms with different shapes of one effect have the same."""
        return self.effect.name, self.joint


@dataclass(frozen=True, eq=False)
class Term:
    """One effect on one joint with one shape, and its columns.

    Attributes:
        effect: An effect of the catalogue, or a structure that has no name there.
        joint: Its joint, None for the whole robot.
        shape: Parameters in which the torque is nonlinear, () if there are none.
        columns: Indices of its columns among all columns.
        size: Number of fitted parameters: coefficients and shape parameters.
        lower, upper: Bounds of each coefficient.
    """

    effect: Rival
    joint: str | None
    shape: Shape
    columns: tuple[int, ...]
    size: int
    lower: tuple[float, ...]
    upper: tuple[float, ...]

    def __hash__(self) -> int:
        # With a hash by address the order of a set of terms would differ between runs.
        return self.columns[0]

    @cached_property
    def effect_joint(self) -> tuple[str, str | None]:
        """Name of the effect and its joint; terms with different shapes of one effect have the same."""
        return self.effect.name, self.joint

    @cached_property
    def column_set(self) -> frozenset[int]:
        """Its columns as a set."""
        return frozenset(self.columns)

    @property
    def named(self) -> bool:
        """False for a structure that has no name in the catalogue."""
        return isinstance(self.effect, Effect)


def shapes_of(
    robot: Robot,
    operation: Operation,
    found: tuple[FoundEffect, ...],
    additional: tuple[FoundEffect, ...] = (),
    own: tuple[Effect, ...] = (),
    groups_of_joints: tuple[str, ...] = (),
) -> tuple[tuple[Rival, str | None, tuple[Shape, ...]], ...]:
    """Effects, joints and shapes that the search tries; effects that the recordings cannot show are left out.

    A joint whose load is nearly constant does not separate some effects, such as friction and friction that grows with
    the load. If one of them was found there, its shapes are also tried for the others.

    Args:
        robot: Determines which effects are possible on which joints.
        operation: Samples of all recordings.
        found: Effects that the last fit found; shapes near theirs replace the effect's grid of shapes.
        additional: Effects that a separate method found, such as resonances; their shapes are tried beside the grid.
        own: Effects that act in one of several recordings only.
        groups_of_joints: Sets of joints on which one cause may have one common parameter, their names joined by ``+``.
    """
    near = {point.effect_joint: point for point in found}
    out = []
    # A fit has one point mass: a payload of one recording replaces a payload that all recordings share.
    own_payload = any(effect.inertial == "point mass" for effect in own)
    common = [one for one in catalogue.effects_of(robot) if not (own_payload and one.inertial == "point mass")]
    for effect in (*common, *own, *STRUCTURES):
        for joint in (*effect.places(robot), *(groups_of_joints if effect.shared else ())):
            if effect.untestable(robot, operation, joint) is not None or _hidden_by_drives(robot, effect, joint):
                continue
            point = near.get((effect.name, joint))
            if point is None:
                more_shapes = [point.shape for point in additional if point.effect_joint == (effect.name, joint)]
                alike = [point for point in found if point.joint == joint and effect.name in point.effect.same_shapes]
                more_shapes += [point.shape for point in alike if _load_is_steady(robot, operation, joint)]
                shapes = tuple(dict.fromkeys((*effect.shapes(robot, operation, joint), *more_shapes)))
            else:
                shapes = effect.refined(point.coefficients, point.shape)
                # If a special case of the law was found, too, all shapes are still tried, even those that the recording
                # hardly shows.
                if any((name, joint) in near for name in effect.contains):
                    shapes = tuple(dict.fromkeys((*shapes, *effect.shapes(robot, operation, joint))))
            out.append((effect, joint, tuple(shapes)))
    return tuple(out)


def _load_is_steady(robot: Robot, operation: Operation, joint: str | None) -> bool:
    """True if the load of a joint (the torque that its transmission passes) varies little compared with its mean."""
    if joint not in robot.joint_names:
        return False
    load = operation.transmitted[:, robot.joint_names.index(joint)]
    return bool(abs(load.mean()) > _STEADY * load.std())


def _hidden_by_drives(robot: Robot, effect: Rival, joint: str | None) -> str | None:
    """Reason why an effect cannot be tested because drives are missing or their torque is unknown; None if it can.

    The measured torque of a joint without a drive is zero, so its residual is minus the modelled torque, and a torque
    constant or friction under load would always explain it. If no torque at all is known, all inertial parameters may
    be scaled alike, and bodies without mass would fit best.
    """
    own = robot.actuators[robot.joint_names.index(joint)] if joint in robot.joint_names else None
    if own is not None and not own.drive_known:
        return f"the torque of the drive of {joint} is not known"
    if own is not None and not own.actuated and effect.needs_drive:
        return f"{joint} has no drive (actuated: false in robot.yaml)"
    if effect.inertial is None or any(one.actuated and one.drive_known for one in robot.actuators):
        return None
    return "no joint that is judged has a drive: inertias show there in their ratios only"


def untestable_effects(
    robot: Robot, operation: Operation, tried: frozenset[tuple[str, str | None]] | None = None
) -> tuple[tuple[str, str | None, str], ...]:
    """Effects and joints that the search did not try, each with the reason in words.

    Args:
        robot: Determines which effects are possible on which joints.
        operation: Samples of all recordings.
        tried: Effects and joints that the search tried; None: all that the recordings can show.
    """
    out = []
    for effect in catalogue.effects_of(robot):
        for joint in effect.places(robot):
            why = _hidden_by_drives(robot, effect, joint) or effect.untestable(robot, operation, joint)
            if why is None and tried is not None and (effect.name, joint) not in tried:
                why = f"what the given model leaves on {joint} has no trace of it, so that no size of it was tried"
            if why is not None:
                out.append((effect.name, joint, why))
    return tuple(out)


def merged(operations: tuple[Operation, ...]) -> Operation:
    """All operations in succession, as one.

    The motion jumps from one operation to the next, so the result is used for ranges and periodograms only.
    """
    if len(operations) == 1:
        return operations[0]
    start, times = 0.0, []
    for operation in operations:
        times.append(operation.t - operation.t[0] + start)
        start = float(times[-1][-1]) + operation.dt
    t = np.concatenate(times)
    q, v, a, tau, expected, logged = (joined([getattr(o, name) for o in operations]) for name in SERIES[1:])
    temperature = None
    if any(o.temperature is not None for o in operations):
        temperature = np.concatenate([_series_or_constant(o.temperature, o.q, np.nan) for o in operations])
    whole = Operation(
        t,
        q,
        v,
        a,
        operations[0].robot,
        tau,
        expected,
        logged,
        residual_of_fit=joined([o.residual for o in operations]),
        base=joined_bases([o.base for o in operations]),
        band_hz=operations[0].band_hz,
        temperature=temperature,
        references=_references(operations, t),
    )
    return whole.made_of(operations)


def _series_or_constant(series: Array | None, like: Array, value: float) -> Array:
    """The series, or a constant one with the shape of ``like`` if there is none."""
    return np.full_like(like, value) if series is None else series


def _references(operations: tuple[Operation, ...], t: Float[Array, " N"]) -> References | None:
    """References of all operations in succession, zero for operations without references; None if none has any."""
    known = [operation.references for operation in operations if operation.references is not None]
    if not known:
        return None
    q_ref, commanded = (
        np.concatenate(
            [_series_or_constant(o.references and getattr(o.references, name), o.q, 0.0) for o in operations]
        )
        for name in ("q_ref", "commanded")
    )
    gain, limits, most = (np.max([getattr(one, of) for one in known], axis=0) for of in ("gain", "limits", "most"))
    return References(t, q_ref, commanded, gain, limits, np.min([one.least for one in known], axis=0), most)


def ordered(terms: Iterable[Term]) -> tuple[Term, ...]:
    """Terms in the order of their columns, so that results do not depend on the order of a set."""
    return tuple(sorted(terms, key=lambda term: (term.columns, term.effect_joint[0])))
