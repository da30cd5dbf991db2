"""An encoder disc off its centre: ``reading = q + A sin(n q + p)``, with ``n = 1`` cycle per turn of the joint.

The true motion differs from the reading. So the residual torque is periodic in the joint's angle. Unlike the torque of
cogging, it grows with acceleration and with speed squared; the gravity torque changes a little too. Over a small arc
the error looks like an encoder offset. The rotor inertia is multiplied by the same wrong acceleration, so the computed
torque of the rotor is wrong too, whether the encoder is on the motor or on the link. If the encoder is on the motor, an
eccentric disc would repeat with each turn of the motor; an error with one cycle per turn of the joint (``n = 1``) then
comes from an eccentric gear on the joint's axis. URDF and MJCF have no place for this effect.
"""

from __future__ import annotations

import numpy as np

from phantom_dyn._kernels.jit import inlined_jit
from phantom_dyn.effects.author import (
    Array,
    Effect,
    EffectWords,
    Law,
    Operation,
    Parameter,
    Robot,
    Shape,
    Signature,
    Simulated,
    reading_law,
    row_of,
)
from phantom_dyn.effects.support.displaced import change_by_reading, displaced, exact_change_by_reading
from phantom_dyn.effects.support.rows import branch_rows
from phantom_dyn.motion import Motion

ORDER = 1.0
"""Periods of the error in one turn of the joint."""
# Smallest arc [rad] that shows the effect; over this arc a sine differs from a straight line by 1 % of its amplitude.
_LEAST_ARC = 0.5
# Largest amplitude of a sound device [rad].
_LARGEST = 0.1
# Number of Newton steps for the true angle. They converge quadratically from a first guess whose error is at most the
# amplitude.
_NEWTON_STEPS = 8
# Largest slope of the error over the position; at a slope of 1 the reading would be constant while the joint turns.
_STEEPEST = 0.5


class EncoderEccentricity(Effect):
    """Error of the encoder of one joint that is periodic in its position."""

    name = "encoder_eccentricity"
    regime = "periodic_in_angle"
    made_of = ("acceleration", "model")
    acts_as = "load"
    fitted = "first order"
    words = EffectWords(
        name="encoder eccentricity",
        meaning="the position is read with an error that repeats with each turn",
        next_step="Check how the encoder disc is centred, or correct the reading with a table over the angle.",
        size="of {amplitude}",
        parameters={
            "amplitude": "largest error of the reading",
            "phase": "phase of the error at position zero",
            "order": "periods of the error in one turn",
        },
        shown_over=("phase",),
        separated_by="link encoder",
        lost="eccentric encoders",
    )

    def places(self, robot: Robot) -> tuple[str | None, ...]:
        """All revolute joints."""
        return tuple(name for name, linear in zip(robot.joint_names, robot.prismatic, strict=True) if not linear)

    def parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """``amplitude`` A, ``phase`` p and ``order`` n."""
        unit = robot.position_units[row_of(robot, joint)]
        return (
            Parameter(
                "amplitude",
                unit,
                0.0,
                plausible=(0.0, _LARGEST),
                plausible_because="a disc so far off its centre that it reads six degrees wrong leaves its sensor",
            ),
            Parameter(
                "phase",
                "rad",
                plausible=(-np.pi, np.pi),
                plausible_because="a disc may be off its centre to any side",
            ),
            Parameter(
                "order",
                "1",
                0.0,
                default=ORDER,
                plausible=(1.0, 100.0),
                plausible_because="a disc off its centre repeats once a turn, a magnet or gear a few times",
            ),
        )

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """Additional drive torque per unit of a sine and of a cosine of the reading."""
        row = row_of(robot, joint)
        unit = robot.position_units[row]
        columns = [change_by_reading(operation, row, *_error(operation, row, phase)) for phase in (0.0, 0.5 * np.pi)]
        rows = branch_rows(robot, joint)
        values = -np.stack(columns, axis=-1)[:, list(rows)]
        return Signature(rows, values, ("sine", "cosine"), (unit, unit))

    def from_coefficients(self, robot: Robot, joint: str | None, coefficients: Array, shape: Shape) -> Array:
        """Amplitude and phase from the coefficients of sine and cosine."""
        sine, cosine = coefficients
        return np.array([np.hypot(sine, cosine), np.arctan2(cosine, sine), ORDER])

    def probe(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[str, Array]:
        """Size of the effect: the amplitude, at phase zero."""
        return "amplitude", np.array([1.0, 0.0])

    def untestable(self, robot: Robot, operation: Operation, joint: str | None) -> str | None:
        """Reason if the joint turns over a small arc only, where the error looks like an offset."""
        arc = _arc(robot, operation, joint)
        if arc < _LEAST_ARC:
            return f"the joint turns by {arc:.2f} rad only: over so small an arc a sine looks like a line"
        return None

    def looks_like(self, robot: Robot, operation: Operation, joint: str | None, other: str, theta: Array) -> bool:
        """True for an encoder offset that a disc may have, if the joint turns over a small arc only."""
        is_offset = other == "encoder_offset" and abs(theta.item()) <= _LARGEST
        return is_offset and _arc(robot, operation, joint) < _LEAST_ARC

    def torque(self, robot: Robot, operation: Operation, joint: str | None, theta: Array) -> Array:
        """Drive torque of the motion as read, minus that of the true motion."""
        row = row_of(robot, joint)
        return -exact_change_by_reading(robot, operation, row, *_true_minus_read(operation, row, theta))

    def reads_one_place(self, theta: Array) -> bool:
        """True if the reading grows with the position everywhere."""
        amplitude, _, order = theta
        return bool(order * amplitude < _STEEPEST)

    def true_motion(self, robot: Robot, motion: Motion, joint: str | None, theta: Array) -> tuple[Robot, Motion]:
        """The positions at which the encoder gives these readings."""
        row = row_of(robot, joint)
        return robot, displaced(motion, row, *_true_minus_read(motion, row, theta))

    def simulated(self, robot: Robot, joint: str | None, theta: Array) -> Simulated:
        """A reading law that adds the error."""
        return Simulated(laws=(Law(eccentric_law, row_of(robot, joint), tuple(map(float, theta))),))


def _arc(robot: Robot, operation: Operation, joint: str | None) -> float:
    """Arc over which a joint turns [rad]."""
    return float(np.ptp(operation.q[:, row_of(robot, joint)]))


def _true_minus_read(motion: Motion, row: int, theta: Array) -> tuple[Array, Array, Array]:
    """True minus read position, velocity and acceleration of a joint."""
    amplitude, phase, n = theta
    q, v, a = (x[:, row] for x in (motion.q, motion.v, motion.a))
    angle = q - amplitude * np.sin(n * q + phase)
    for _ in range(_NEWTON_STEPS):
        excess = angle + amplitude * np.sin(n * angle + phase) - q
        angle = angle - excess / (1.0 + n * amplitude * np.cos(n * angle + phase))
    slope = 1.0 + n * amplitude * np.cos(n * angle + phase)
    speed = v / slope
    acceleration = (a + n**2 * amplitude * np.sin(n * angle + phase) * speed**2) / slope
    return angle - q, speed - v, acceleration - a


def _error(operation: Operation, row: int, phase: float) -> tuple[Array, Array, Array]:
    """``sin(q + phase)`` and its first two time derivatives along the measured motion."""
    q, v, a = (x[:, row] for x in (operation.q, operation.v, operation.a))
    sine, cosine = np.sin(q + phase), np.cos(q + phase)
    return sine, cosine * v, cosine * a - sine * v**2


@reading_law
@inlined_jit
def eccentric_law(q: float, amplitude: float, phase: float, order: float) -> float:
    """Reading of an encoder with an eccentric disc at position ``q``."""
    return q + amplitude * np.sin(order * q + phase)
