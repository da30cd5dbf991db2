"""A reference that arrives late in a drive whose own loop is fast: ``u(t) = kp (q_ref(t - d) - q(t))``.

Some torques are not measured, but computed from the reference as it was sent (by the log's author or from a stated
controller). The true torque is then that of an earlier reference. Only the reference is late, not the feedback: an
`input_delay` would shift the whole torque and make the loop less stable. While the joint follows its reference closely,
the effect looks like viscous friction of ``kp d``. A delay that all joints share, such as that of a bus, has the place
None. The torque is not linear in ``d``. So the column is a secant: the change of torque from no delay to the last
estimate of ``d`` (the shape), per second of delay. The column contains no noise of the positions.
"""

from __future__ import annotations

import numpy as np

from phantom_dyn.effects.author import (
    Array,
    EffectWords,
    Float,
    ModelNumbers,
    Operation,
    Parameter,
    Robot,
    Shape,
    Signature,
    Simulated,
)
from phantom_dyn.effects.support.rows import driven_rows, hidden_behind_drive, secant, torque_on_rows
from phantom_dyn.effects.support.timing import LONGEST, Timing

# Delays at which a fit starts [s]: a cycle of a fast and of a slow bus.
_STARTS = (0.01, 0.03)
# Shortest delay of a secant [s], so that its torque differences are larger than rounding errors.
_LEAST = 1e-5


class ReferenceDelay(Timing):
    """Delay of the reference of one drive, or of all."""

    name = "reference_delay"
    regime = "high_speed"
    shows_with = "velocity"
    fitted = "secant"
    words = EffectWords(
        name="a late reference",
        meaning="the reference arrives in the drive later than it is recorded, the position feedback does not",
        next_step=(
            "Delay the commands of the simulated drive by this time (not its torque), or shorten the bus cycle; record "
            "with two gains of the drive to separate it from viscous friction."
        ),
        size="of {delay}",
        parameters={"delay": "time from the recorded reference to the one that the drive follows"},
        shown_over=("velocity", "time"),
        separated_by="timing",
    )

    def parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """One parameter: ``delay`` of the reference."""
        return (
            Parameter(
                "delay",
                "s",
                0.0,
                plausible=(0.0, 0.15),
                plausible_because="buses of servos take 5 to 50 ms, and a frame of a camera that paces them 33 ms",
            ),
        )

    def shapes(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[Shape, ...]:
        """Delays at which a fit starts [s]."""
        return tuple((start,) for start in _STARTS)

    def refined(self, coefficients: Array, shape: Shape) -> tuple[Shape, ...]:
        """The next delay of the secant [s]: the last estimate."""
        return secant(max(float(coefficients[0]), 0.0), _LEAST)

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """Torque computed from the reference as sent minus that from the late reference, per second of delay."""
        rows = driven_rows(robot, joint)
        columns = -_change_of_torque(operation, rows, shape[0]) / shape[0]
        return Signature(rows, columns[:, :, None], ("delay",), ("s",))

    def bounds_in(
        self, robot: Robot, operation: Operation, joint: str | None, shape: Shape
    ) -> tuple[tuple[float, float], ...]:
        """Bounds of the delay [s], narrowed by the recorded output of the drives if there is one."""
        known = operation.references
        if known is None:
            return self.coefficient_bounds(robot, joint, shape)
        rows = list(driven_rows(robot, joint))
        return ((float(known.least[rows].min()), min(float(known.most[rows].max()), LONGEST)),)

    def untestable(self, robot: Robot, operation: Operation, joint: str | None) -> str | None:
        """Reason if the torque was not computed from references: only such a torque shows their delay."""
        hidden = hidden_behind_drive(robot, "the delay of a reference")
        if hidden is not None:
            return hidden
        known = operation.references
        if known is None or not known.gain[list(driven_rows(robot, joint))].any():
            return "the torque was not computed from references: it was measured, or no controller or drive is known"
        return None

    def remark(self, robot: Robot, joint: str | None, theta: Array) -> str:
        """Warning that a held reference looks the same; empty if the configuration states ``reference_hold``."""
        if robot.reference_hold is not None:
            return ""
        return (
            f"A reference that is held until the next one looks as if it were half of that time late: if references "
            f"come every {2e3 * theta.item():.3g} ms, this is no gap. State reference_hold: zoh in robot.yaml if each "
            "row of the log brings a new one; of more rows, log the reference that the drive holds."
        )

    def torque(self, robot: Robot, operation: Operation, joint: str | None, theta: Array) -> Array:
        """Torque with the late reference minus that with the reference as it was sent."""
        rows = driven_rows(robot, joint)
        return torque_on_rows(robot, rows, _change_of_torque(operation, rows, theta.item()))

    def simulated(self, robot: Robot, joint: str | None, theta: Array) -> Simulated:
        """Delay of the references of each joint's controller."""
        late = np.zeros(robot.nv)
        late[list(driven_rows(robot, joint))] = theta.item()
        return Simulated(reference_delay=late)

    def model_numbers(self, robot: Robot, joint: str | None, theta: Array) -> ModelNumbers:
        """The delay, which describes the effect completely."""
        return ModelNumbers(whole=True, reference_delay=theta.item())


def _change_of_torque(operation: Operation, rows: tuple[int, ...], delay: float) -> Float[Array, "N m"]:
    """Change of torque if the reference comes ``delay`` later; zero if no reference is known."""
    if operation.references is None:
        return np.zeros((len(operation.t), len(rows)))
    return operation.references.later(delay, rows)
