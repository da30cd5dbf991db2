"""A drive with a delay: ``true torque(t) = command(t - d)``, so that the command leads the needed torque.

The torque is not linear in ``d``. So the column is a secant: the change of torque from no delay to the last estimate of
``d`` (the shape), per second of delay. To first order a delay equals a lag of the same time. In a position loop it
looks like viscous friction of about ``kp d``: recordings with two controller gains, or steps, separate them. One delay
on all drives is an effect of the whole robot. MJCF: actuator ``delay`` with ``nsample``; URDF has no place for it.
"""

from __future__ import annotations

import numpy as np

from phantom_dyn._kernels.jit import inlined_jit
from phantom_dyn.effects.author import (
    Array,
    EffectWords,
    Float,
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
from phantom_dyn.effects.support.rows import driven_rows, hidden_behind_drive, secant, torque_on_rows
from phantom_dyn.effects.support.timing import Timing

# Delays at which a fit starts [s], besides one sample.
_STARTS = (0.002, 0.005, 0.012)
# Shortest delay of a secant [s], so that its torque differences are larger than rounding errors.
_LEAST = 1e-5


class InputDelay(Timing):
    """Delay of the torque of one drive, or of all."""

    name = "input_delay"
    regime = "high_acceleration"
    made_of = ("acceleration", "model", "torque")
    shows_with = "acceleration"
    fitted = "secant"
    words = EffectWords(
        name="an input delay",
        meaning="the torque acts later than it is recorded",
        next_step=(
            "Check time stamps and bus cycles, and put the delay into the simulation; record with two controller "
            "gains to separate it from friction."
        ),
        size="of {delay}",
        parameters={"delay": "time from the recorded to the acting torque"},
        shown_over=("torque_rate",),
        separated_by="timing",
    )

    def parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """One parameter: ``delay`` of the true torque."""
        return (
            Parameter(
                "delay",
                "s",
                0.0,
                plausible=(0.0, 0.1),
                plausible_because="a loop that is later than a tenth of a second can hardly be closed",
            ),
        )

    def shapes(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[Shape, ...]:
        """Delays at which a fit starts [s]: one sample, and some longer ones."""
        first = max(operation.dt, _LEAST)
        return ((first,), *((start,) for start in _STARTS if not np.isclose(start, first, rtol=0.2)))

    def refined(self, coefficients: Array, shape: Shape) -> tuple[Shape, ...]:
        """The next delay of the secant [s]: the last estimate."""
        return secant(max(float(coefficients[0]), 0.0), _LEAST)

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """One column: change of the needed torque over the delay ``shape``, per second of delay."""
        rows = driven_rows(robot, joint)
        columns = _ahead(operation, rows, shape[0]) / shape[0]
        return Signature(rows, columns[:, :, None], ("delay",), ("s",))

    def untestable(self, robot: Robot, operation: Operation, joint: str | None) -> str | None:
        """Reason if the torque comes from a sensor behind the drive, which does not show the delay."""
        return hidden_behind_drive(robot, "the delay of the drive")

    def torque(self, robot: Robot, operation: Operation, joint: str | None, theta: Array) -> Array:
        """True torque minus commanded torque."""
        rows = driven_rows(robot, joint)
        return torque_on_rows(robot, rows, -_ahead(operation, rows, theta.item()))

    def simulated(self, robot: Robot, joint: str | None, theta: Array) -> Simulated:
        """Mean of the delayed command over each time step, exact because the command is constant during a step.

        The state is the part of the command history that is still needed. It is flattened from one row for each step:
        length of the step, then the commands during the step. Before the first step the first command applies.
        """
        rows, delay = list(driven_rows(robot, joint)), theta.item()

        def command(state: Array, dt: float, tau: Array) -> tuple[Array, Array]:
            history = state.reshape(-1, 1 + len(rows))
            dt = max(dt, 1e-12)
            history = np.vstack([history, [dt, *tau[rows]]])
            ends = np.cumsum(history[:, 0]) - history[:, 0].sum()  # time before the end of this step
            out = tau.copy()
            out[rows] = _mean_held(history, ends, -delay - dt, -delay)
            # The next mean begins one delay before the end of this step: steps that ended earlier are not needed.
            return history[ends > -delay].ravel(), out

        def series(t: Array, tau: Array) -> Array:
            out = tau.copy()
            for row in rows:
                out[:, row] = np.interp(t - delay, t, tau[:, row])
            return out

        laws = tuple(Law(delay_law, row, (delay,)) for row in rows)
        return Simulated(command=command, series=series, laws=laws)

    def model_numbers(self, robot: Robot, joint: str | None, theta: Array) -> ModelNumbers:
        """The delay, which describes the effect completely."""
        return ModelNumbers(whole=True, delay=theta.item())


def _ahead(operation: Operation, rows: tuple[int, ...], delay: float) -> Float[Array, "N m"]:
    """Change of the needed torque over the next ``delay`` seconds; after the last sample the torque is constant."""
    expected = operation.expected[:, list(rows)]
    if len(expected) < 2:
        return np.zeros_like(expected)
    # Cubic interpolation with slopes from neighbouring samples: a spline over all samples would oscillate where the
    # friction changes its sign.
    t, slopes = operation.t, operation.expected_rate[:, list(rows)]
    later = np.minimum(t + delay, t[-1])
    k = np.clip(np.searchsorted(t, later, side="right") - 1, 0, len(t) - 2)
    step = (t[k + 1] - t[k])[:, None]
    share = (later - t[k])[:, None] / step
    rise, first, last = expected[k + 1] - expected[k], step * slopes[k], step * slopes[k + 1]
    bend = first + share * (3 * rise - 2 * first - last + share * (first + last - 2 * rise))
    return expected[k] + share * bend - expected


def _mean_held(history: Float[Array, "n k"], ends: Float[Array, " n"], start: float, stop: float) -> Float[Array, " m"]:
    """Mean command between two times; before the first step the command is the first one."""
    begin = np.maximum(ends - history[:, 0], start)
    begin[0] = start
    lengths = np.clip(np.minimum(ends, stop) - begin, 0.0, None)
    return lengths @ history[:, 1:] / lengths.sum()


@command_law
@inlined_jit
def delay_law(
    line: Float[Array, "n 2"], first: int, last: int, delay: float, dt: float, tau: float
) -> tuple[int, int, float]:
    """First and last index of the delay line after one step, and the mean command that leaves the line.

    The line always contains ``delay`` seconds of commands: as a step enters, commands of the same duration leave.

    Args:
        line: Ring buffer with the length [s] and the command of each delayed step; it has two rows more than there are
            steps in a delay.
        first: Index of the oldest step.
        last: Index of the newest step, -1 at the first call.
        delay: Delay of the line [s].
        dt: Length of this step [s].
        tau: Command during this step.
    """
    if last < 0:
        first = last = 0
        line[0, 0], line[0, 1] = delay, tau
    last = last + 1 if last + 1 < len(line) else 0
    line[last, 0], line[last, 1] = dt, tau
    wanted, total = dt, 0.0
    while True:
        ready = line[first, 0]
        if ready > wanted or first == last:
            line[first, 0] = ready - wanted
            return first, last, (total + wanted * line[first, 1]) / dt
        total += ready * line[first, 1]
        wanted -= ready
        first = first + 1 if first + 1 < len(line) else 0
