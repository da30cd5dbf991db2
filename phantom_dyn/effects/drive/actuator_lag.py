"""A drive that follows its command as a first-order low pass: ``T dtau/dt + tau = command``.

The command is the needed torque plus ``T`` times its time derivative, exactly. To first order a lag equals a
delay of ``T``; motion of high frequency separates the two. A lag that all joints share has the place None.
MJCF: actuator ``dyntype="filterexact"`` with ``dynprm``; URDF has no place for it.
"""

from __future__ import annotations

import numpy as np

from phantom_dyn._kernels.jit import jit
from phantom_dyn.effects.author import (
    Array,
    EffectWords,
    Law,
    ModelNumbers,
    Operation,
    Parameter,
    Robot,
    Shape,
    Signature,
    Simulated,
    command_law,
)
from phantom_dyn.effects.support.rows import driven_rows, hidden_behind_drive, torque_on_rows
from phantom_dyn.effects.support.timing import Timing
from phantom_dyn.signals.recursive import lagging_linear


class ActuatorLag(Timing):
    """First-order lag of one drive, or of all."""

    name = "actuator_lag"
    regime = "high_acceleration"
    made_of = ("acceleration", "model", "torque")
    shows_with = "acceleration"
    words = EffectWords(
        name="actuator lag",
        meaning="the torque follows its command like a first-order low pass",
        next_step="Check the bandwidth of the current loop, and put the lag into the simulation.",
        size="with a time constant of {time_constant}",
        parameters={"time_constant": "time after which a step of torque has come to 63 %"},
        shown_over=("torque_rate",),
        separated_by="timing",
    )

    def parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """One parameter: ``time_constant`` of the low pass."""
        return (
            Parameter(
                "time_constant",
                "s",
                0.0,
                plausible=(0.0, 0.1),
                plausible_because="a drive slower than a tenth of a second can hardly be controlled",
            ),
        )

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """One column: time derivative of the needed torque; its coefficient is the time constant."""
        rows = driven_rows(robot, joint)
        return Signature(rows, operation.expected_rate[:, list(rows), None], ("time_constant",), ("s",))

    def untestable(self, robot: Robot, operation: Operation, joint: str | None) -> str | None:
        """Reason if the torque comes from a sensor behind the drive, which does not show the lag."""
        return hidden_behind_drive(robot, "the lag of the drive")

    def torque(self, robot: Robot, operation: Operation, joint: str | None, theta: Array) -> Array:
        """True torque minus commanded torque."""
        rows = driven_rows(robot, joint)
        return torque_on_rows(robot, rows, -theta.item() * operation.expected_rate[:, list(rows)])

    def simulated(self, robot: Robot, joint: str | None, theta: Array) -> Simulated:
        """Mean torque over each time step, exact because the command is constant during a step.

        The state is the torque at the end of the last step. It starts as NaN, which means the first command.
        """
        rows, time_constant = list(driven_rows(robot, joint)), theta.item()

        def series(t: Array, tau: Array) -> Array:
            out, dt = tau.copy(), (t[-1] - t[0]) / (len(t) - 1)
            for row in rows:
                out[:, row] = lagging_linear(tau[:, row], dt, time_constant)
            return out

        laws = tuple(Law(lag_law, row, (time_constant,), (np.nan,)) for row in rows)
        return Simulated(start=np.full(len(rows), np.nan), series=series, laws=laws)

    def model_numbers(self, robot: Robot, joint: str | None, theta: Array) -> ModelNumbers:
        """The time constant, which describes the effect completely."""
        return ModelNumbers(whole=True, lag=theta.item())


@command_law
@jit
def lag_law(start: float, tau: float, dt: float, time_constant: float) -> tuple[float, float]:
    """Torque at the end of a step, and its mean over the step; ``start`` is the torque at its start, NaN if unknown."""
    if np.isnan(start):
        start = tau
    if time_constant <= 0.0:
        return tau, tau
    steps = max(dt / time_constant, 1e-12)
    decay = np.expm1(-steps)
    return tau + (start - tau) * (1.0 + decay), tau - (start - tau) * decay / steps
