"""Generic structures of a torque residual for causes that the catalogue of effects lacks.

Each is a small group of columns for a class of causes: a slow change with time, a periodic force, a force that depends
on the position, drag that grows with the square of the speed, drives that weaken with the load of all joints, a wrong
scale of an encoder, and a force that carries weight without inertia. If the search chooses a structure, the cause of
that part of the residual is reported as `unknown`. Structures compete with the effects of the catalogue at the price
of their parameters. So an effect that only resembles the true structure is not claimed, and an effect of the catalogue
beside such a structure is still found.

The regime of a structure is the part of the motion in which it is largest. Its signature is its columns and the joints
on which they act.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.dynamics import rigid_body_regressor
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.rival import Rival, Shape, Signature, Source
from phantom_dyn.effects.support.displaced import change_by_reading
from phantom_dyn.effects.support.rows import branch_rows, row_of
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion
from phantom_dyn.random_streams import random_stream
from phantom_dyn.signals.recursive import lagging

_SLOW = 3  # largest number of half waves of a drift within the recording
# If a joint's position and velocity explain more than this share of the squares of sine and cosine at a frequency, a
# torque at that frequency is an effect of the motion and no rhythm.
_OF_THE_MOTION = 0.9
# Smallest square of a combination of columns, as a share of the largest, with which it counts as a column of its own
# (the largest counts as at least one, so that a link without weight has no column); number of postures for the squares.
_INDEPENDENT, _POSTURES = 1e-4, 60


def _on_row(robot: Robot, joint: str | None, columns: list[Float[Array, " N"]]) -> Signature:
    """Columns that act on one joint alone."""
    names = tuple(f"c{k}" for k in range(len(columns)))
    return Signature((row_of(robot, joint),), np.array(columns).T[:, None, :], names, ("",) * len(columns))


def _scaled(x: Float[Array, " N"]) -> Float[Array, " N"]:
    """A series divided by the 95th percentile of its magnitude."""
    return x / max(float(np.percentile(np.abs(x), 95)), 1e-12)


class Drift(Rival):
    """An offset, a friction or a gain of one joint that changes slowly over the recording.

    Args:
        name: Name of the structure.
        steady: Name of the effect without the change over time.
        column: Gives the column of the steady effect for an operation and the index of a joint.
        made_of: Series from which the column is made.
    """

    regime = "time_drift"

    def __init__(
        self, name: str, steady: str, column: Callable[[Operation, int], Array], made_of: tuple[Source, ...] = ()
    ):
        self.name, self._steady, self._column, self.made_of = name, (steady,), column, made_of

    @property
    def contains(self) -> tuple[str, ...]:
        """The effect without any change over time."""
        return self._steady

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """Columns of the steady effect, times one and times slow cosines of time."""
        steady = self._column(operation, row_of(robot, joint))
        phase = np.pi * (operation.t - operation.t[0]) / max(operation.t[-1] - operation.t[0], 1e-9)
        return _on_row(robot, joint, [steady * np.cos(k * phase) for k in range(_SLOW + 1)])


class DriveDrift(Drift):
    """A drift that changes the torque of the drive itself."""

    acts_as = "drive"


class Rhythm(Rival):
    """A force that is periodic in time, independent of the motion of the robot."""

    name = "rhythm"
    regime = "everywhere"

    def shapes(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[Shape, ...]:
        """The two strongest frequencies [Hz] of the residual, without the frequency of a joint that moves in one sine.

        At that frequency, sine and cosine are the position and the velocity of the joint, and a torque that depends on
        these is no rhythm.
        """
        j = row_of(robot, joint)
        residual = np.array(operation.residual[:, j])
        v = operation.v[:, j]
        plain = np.column_stack([np.ones(len(v)), np.sign(v), v, operation.expected[:, j], operation.q[:, j]])
        residual = residual - plain @ np.linalg.lstsq(plain, residual, rcond=None)[0]
        # Zero-padded to four times the length, so that the frequency is found to a fraction of a spectral line.
        power = np.abs(np.fft.rfft(residual * np.hanning(len(residual)), 4 * len(residual))) ** 2
        frequency = np.fft.rfftfreq(4 * len(residual), operation.dt)
        seconds = operation.t[-1] - operation.t[0]
        # Slower waves are drifts.
        power[(frequency < 4.0 / seconds) | (frequency > 25.0)] = 0.0
        out = []
        for _ in range(2):
            peak = int(np.argmax(power))
            if power[peak] <= 0:
                break
            hertz = float(frequency[peak])
            if not _moves_at(hertz, operation, j):
                out.append((hertz,))
            power[np.abs(frequency - frequency[peak]) < 2.0 / seconds] = 0.0
        return tuple(out)

    def refined(self, coefficients: Float[Array, " k"], shape: Shape) -> tuple[Shape, ...]:
        """The frequency of the last fit."""
        return (shape,)

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """Sine and cosine of time."""
        phase = 2 * np.pi * shape[0] * (operation.t - operation.t[0])
        return _on_row(robot, joint, [np.sin(phase), np.cos(phase)])


def _moves_at(hertz: float, operation: Operation, j: int) -> bool:
    """True if sine and cosine of a frequency are sums of a joint's position and velocity."""
    phase = 2 * np.pi * hertz * (operation.t - operation.t[0])
    waves = np.column_stack([np.sin(phase), np.cos(phase)])
    own = np.column_stack([np.ones(len(phase)), operation.q[:, j], operation.v[:, j]])
    residual = waves - own @ np.linalg.lstsq(own, waves, rcond=None)[0]
    return bool(np.sum(residual**2) < (1.0 - _OF_THE_MOTION) * np.sum(waves**2))


class Field(Rival):
    """A force on one joint that depends on the positions of all joints of its branch, as of a contact or a cable."""

    name = "field"
    regime = "posture"

    @property
    def contains(self) -> tuple[str, ...]:
        """A constant force, and one that is linear in the joint's own position."""
        return ("torque_offset", "parasitic_spring")

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """Hinge functions of each position: zero up to a knot and linear beyond it, like the force of a contact."""
        columns = [np.ones(len(operation.t))]
        for k in branch_rows(robot, joint):
            q = operation.q[:, k]
            low, high = np.percentile(q, [2, 98])
            x = (q - low) / max(high - low, 1e-3)
            knots = (0.15, 0.3, 0.5, 0.7, 0.85) if k == row_of(robot, joint) else (0.25, 0.75)
            columns.append(x)
            columns += [np.maximum(x - knot, 0.0) for knot in knots]
        return _on_row(robot, joint, columns)


class Contact(Rival):
    """A spring on one joint that acts on one side of a position only."""

    name = "contact"
    regime = "posture"

    def shapes(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[Shape, ...]:
        """Positions where the contact begins, spread over the travel, and the side on which it acts."""
        low, high = np.percentile(operation.q[:, row_of(robot, joint)], [1, 99])
        return tuple(
            (low + part * (high - low), side) for side in (-1.0, 1.0) for part in (0.15, 0.32, 0.5, 0.68, 0.85)
        )

    def refined(self, coefficients: Float[Array, " k"], shape: Shape) -> tuple[Shape, ...]:
        """The same position and positions near it."""
        return tuple((shape[0] + step, shape[1]) for step in (-0.1, -0.03, 0.0, 0.03, 0.1))

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """Depth of the joint beyond the position."""
        q = operation.q[:, row_of(robot, joint)]
        return _on_row(robot, joint, [np.maximum(shape[1] * (q - shape[0]), 0.0)])


class Drag(Rival):
    """Friction of one joint that does not grow in proportion to its velocity, such as that of a fluid."""

    name = "drag"
    regime = "high_speed"
    shows_with = "velocity"

    @property
    def contains(self) -> tuple[str, ...]:
        """Friction in proportion to the velocity."""
        return ("viscous_friction",)

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """Velocity, and its square with the sign of the velocity."""
        v = _scaled(operation.v[:, row_of(robot, joint)])
        return _on_row(robot, joint, [v, v * np.abs(v)])


class Supply(Rival):
    """Drives that give less torque when all drives together need more: one drive, or all drives alike."""

    name = "supply"
    scope = "either"
    regime = "high_load"
    made_of = ("acceleration",)
    acts_as = "drive"

    @property
    def contains(self) -> tuple[str, ...]:
        """A drive that gives less at any load."""
        return ("torque_constant",)

    def shapes(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[Shape, ...]:
        """Time constants [s] with which the supply sags."""
        return ((0.03,), (0.1,), (0.3,))

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """Modelled torque, and modelled torque times the load of all joints.

        For one joint there are also its torque times the power of all joints, and times its own load.
        """
        tau = operation.tau
        key = ("load and power of all drives", shape[0])
        if key not in operation.kept:
            loads = np.abs(tau).sum(axis=1), np.maximum((tau * operation.v).sum(axis=1), 0.0)
            operation.kept[key] = np.array([_scaled(lagging(x, operation.dt, shape[0])) for x in loads])
        load, power = operation.kept[key]
        if joint is None:
            columns = np.stack([tau, tau * load[:, None]], axis=-1)
            return Signature(tuple(range(robot.nv)), columns, ("gain", "sag"), ("1", "1"))
        own = _scaled(tau[:, row_of(robot, joint)])
        return _on_row(robot, joint, [own, own * load, own * power, own * np.abs(own)])


class Reading(Rival):
    """Positions of one joint that are read with a wrong scale, or with a scale that changes over the travel.

    Over an arc of less than a turn an eccentric encoder may look like it.
    """

    name = "reading"
    regime = "posture"
    made_of = ("acceleration", "model")
    acts_as = "load"

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """Change of the torque by errors of the reading in proportion to the position and to its square."""
        row, rows = row_of(robot, joint), branch_rows(robot, joint)
        q, v, a = operation.q[:, row], operation.v[:, row], operation.a[:, row]
        errors = ((q, v, a), (q**2, 2.0 * q * v, 2.0 * (v**2 + q * a)))
        columns = [change_by_reading(operation, row, *error)[:, list(rows)] for error in errors]
        return Signature(rows, np.stack(columns, axis=-1), ("scale", "change"), ("1", "1/rad"))


class Balance(Rival):
    """A force that carries weight of one link without inertia, such as that of a spring balancer or of a rope."""

    name = "balance"
    regime = "posture"
    acts_as = "load"

    def places(self, robot: Robot) -> tuple[str | None, ...]:
        """Joints of a tree on a fixed base whose links have a weight that makes a torque in some posture."""
        if robot.floating or robot.chain is not None:
            return ()
        return tuple(joint for joint in robot.joint_names if _weight_directions(robot, joint).size)

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """Torques at rest by independent combinations of the link's mass and first moments."""
        rows, directions = branch_rows(robot, joint), _weight_directions(robot, joint)
        values = _torques_at_rest(robot, operation, joint)[:, list(rows)] @ directions
        names = tuple(f"c{k}" for k in range(values.shape[-1]))
        return Signature(rows, values, names, ("",) * len(names))


def _torques_at_rest(robot: Robot, motion: Motion, joint: str | None) -> Float[Array, "N nv 4"]:
    """Torques that hold the mass and the first moments of a joint's link, per unit of each."""
    still = motion.with_joints(motion.q, np.zeros_like(motion.v), np.zeros_like(motion.a))
    first = 10 * (robot.model.getJointId(joint) - 1)
    return rigid_body_regressor(robot, still, columns=tuple(range(first, first + 4)))


def _weight_directions(robot: Robot, joint: str | None) -> Float[Array, "4 k"]:
    """Independent combinations of a link's mass and first moments that make torques at rest, over random postures."""
    q = random_stream("postures of balanced links").uniform(-1.0, 1.0, (_POSTURES, robot.nv))
    values = _torques_at_rest(robot, Motion(np.arange(float(_POSTURES)), q, 0.0 * q, 0.0 * q), joint)
    squares, directions = np.linalg.eigh(np.einsum("nmk,nml->kl", values, values))
    return directions[:, squares > _INDEPENDENT * max(float(squares[-1]), 1.0)]


STRUCTURES: tuple[Rival, ...] = (
    Drift("drifting_offset", "torque_offset", lambda operation, j: np.ones(len(operation.t))),
    Drift("drifting_friction", "coulomb_friction", lambda operation, j: np.sign(operation.v[:, j])),
    Drift("drifting_damping", "viscous_friction", lambda operation, j: _scaled(operation.v[:, j])),
    DriveDrift(
        "drifting_gain", "torque_constant", lambda operation, j: _scaled(operation.tau[:, j]), ("acceleration",)
    ),
    Rhythm(),
    Field(),
    Contact(),
    Drag(),
    Supply(),
    Reading(),
    Balance(),
)
