r"""Exact discretisation of a haptic device behind a zero-order hold and any delay.

The force that the computer gives at :math:`kT` acts from :math:`kT + t_d` to :math:`(k + 1)T + t_d`. With
:math:`t_d = dT + \tau`, :math:`0 \le \tau < T`, the state at the samples follows

.. math:: x_{k+1} = \Phi(T) x_k + \Gamma(T - \tau)\, u_{k-d} + \Phi(T - \tau) \Gamma(\tau)\, u_{k-d-1}

without approximation. :math:`\Phi(h) = e^{A h}` and :math:`\Gamma(h) = \int_0^h e^{A s} B\, ds` come from one
exponential of the matrix :math:`[A, B; 0, 0]`. The delay need not be a multiple of the period.

Simulations of robots cannot use these matrices, because the torque is not constant over a whole period and the dynamics
are not linear. They use a queue of past commands instead (`phantom_dyn.effects.drive.input_delay`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from phantom_dyn.array_types import Array, Complex, Float, ReadOnlyArrays
from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.device.frequency_kernels import delayed_input, loop_polynomials
from phantom_dyn.haptics.device.transfer_function import Axis

Controller = tuple[Array, Array, Array, float]
"""State space ``A``, ``B``, ``C``, ``D`` of a digital controller of one input and one output."""

# Difference from a multiple of the period, over the period, up to which a delay counts as this multiple.
_SAME = 1e-9


@dataclass(frozen=True)
class SampledAxis(ReadOnlyArrays):
    """Discrete model of a device from held and delayed forces to position at the samples.

    ``x[k+1] = transition x[k] + newer u[k-steps] + older u[k-steps-1]``,
    ``y[k] = output x[k] + direct_now u[k-steps] + direct_before u[k-steps-1]``.

    Attributes:
        period: Sampling period T [s].
        delay: Delay of the loop in addition to that of the hold [s].
        steps: Number of whole periods in the delay.
        transition: Transition matrix of the state over a period, shape ``(n, n)``.
        newer: Weight of the newer input, shape ``(n,)``.
        older: Weight of the older input, shape ``(n,)``; zero if the delay is a multiple of the period.
        output: Row from state to position, shape ``(n,)``.
        direct_now: Feed-through of the newer input; zero if the delay is not a multiple of the period.
        direct_before: Feed-through of the older input; zero if the delay is a multiple of the period.
    """

    period: float
    delay: float
    steps: int
    transition: Float[Array, "n n"]
    newer: Float[Array, " n"]
    older: Float[Array, " n"]
    output: Float[Array, " n"]
    direct_now: float
    direct_before: float

    @cached_property
    def loop(self) -> tuple[int, float, float, Array, Array, Array]:
        """Steps, feed-through, and the polynomials of `loop_polynomials`."""
        polynomials = loop_polynomials(self.transition, self.newer, self.older, self.output)
        return (self.steps, self.direct_now, self.direct_before, *polynomials)

    def response(self, frequency: Float[Array, " k"]) -> Complex[Array, " k"]:
        """:math:`Z[H(s) G(s) e^{-t_d s}]` at the frequencies [rad/s] up to the Nyquist frequency, shape ``(k,)``."""
        steps, direct_now, direct_before, denominator, of_newer, of_older = self.loop
        x = frequency * self.period
        back = np.exp(-1j * x)
        delta = -2.0 * np.sin(0.5 * x) ** 2 + 1j * np.sin(x)
        low = np.polyval(denominator, delta)
        high = np.polyval(of_newer, delta) + np.polyval(of_older, delta) * back
        return (high / low + direct_now + direct_before * back) * np.exp(-1j * steps * x)

    def closed_loop(self, stiffness: float, virtual_damping: float = 0.0) -> Float[Array, "m m"]:
        r"""Transition matrix of device and virtual wall :math:`u = -(K + B (z - 1) / (T z))\, y`.

        The state consists of that of the device, the last ``steps + 1`` forces, and the last position.
        """
        rate = virtual_damping / self.period
        return self.closed_by((np.zeros((1, 1)), np.ones(1), np.array([-rate]), stiffness + rate))

    def closed_by(self, controller: Controller) -> Float[Array, "m m"]:
        """Transition matrix of the closed loop of device and controller.

        The state consists of that of the device, the last ``steps + 1`` forces, and that of the controller.

        Args:
            controller: ``A``, ``B``, ``C``, ``D`` of ``x[k+1] = A x[k] + B y[k]``, ``-u[k] = C x[k] + D y[k]``.
        """
        A, B, C, D = controller
        n, past_forces = len(self.output), self.steps + 1
        own = n + past_forces
        size = own + len(B)

        def forces(back: int) -> Array:
            """Row that selects the force of ``back`` periods ago from the state."""
            row = np.zeros(size)
            row[n + back - 1] = 1.0
            return row

        position = np.zeros(size)
        position[:n] = self.output
        position += self.direct_before * forces(self.steps + 1)
        if self.steps > 0:
            position += self.direct_now * forces(self.steps)
        force = -D * position
        force[own:] -= C
        if self.steps == 0:
            # Force and position at the same instant depend on each other; this is the solution for the force.
            force = force / (1.0 + D * self.direct_now)
            position = position + self.direct_now * force
        out = np.zeros((size, size))
        out[:n, :n] = self.transition
        out[:n] += np.outer(self.newer, force if self.steps == 0 else forces(self.steps))
        out[:n] += np.outer(self.older, forces(self.steps + 1))
        out[n] = force
        for back in range(1, past_forces):
            out[n + back] = forces(back)
        out[own:, own:] = A
        out[own:] += np.outer(B, position)
        return out

    def spectral_radius(self, stiffness: float, virtual_damping: float = 0.0) -> float:
        """Largest absolute eigenvalue of device and virtual wall, which are stable if it is below one."""
        return float(np.abs(np.linalg.eigvals(self.closed_loop(stiffness, virtual_damping))).max())


def split_delay(period: float, delay: float) -> tuple[int, float]:
    """Number of whole periods in a delay, and the remaining delay [s].

    Raises:
        ParameterError: If the period is not positive, or the delay is negative.
    """
    if not (math.isfinite(period) and period > 0 and math.isfinite(delay) and delay >= 0):
        raise ParameterError(
            f"A sampling period of {period:g} s and a delay of {delay:g} s were given: "
            "give a positive period and a delay of 0 or more."
        )
    steps = math.floor(delay / period + _SAME)
    rest = delay - steps * period
    return steps, (rest if rest > _SAME * period else 0.0)


def discretise(axis: Axis, *, period: float, delay: float = 0.0) -> SampledAxis:
    """Exact discretisation of an axis behind a zero-order hold and a delay.

    Args:
        axis: A model of `phantom_dyn.haptics.device.axis`, or a transfer function.
        period: Sampling period T [s].
        delay: Any delay of 0 or more [s].

    Raises:
        ParameterError: If the period is not positive, or the delay is negative.
    """
    steps, rest = split_delay(period, delay)
    system = axis.state_space
    transition, newer, older = delayed_input(system.A, system.B, period, rest)
    # The position is read just before a new force begins to act. If the delay is not a multiple of the period, the
    # older force acts at this time.
    now, before = (0.0, system.D) if rest > 0 else (system.D, 0.0)
    return SampledAxis(period, delay, steps, transition, newer, older, system.C, now, before)
