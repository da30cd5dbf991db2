"""Rational transfer functions from force to position, and their state space."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from phantom_dyn.array_types import Array, Complex, Float
from phantom_dyn.errors import ParameterError
from phantom_dyn.motion import ReadOnlyArrays


@dataclass(frozen=True)
class StateSpace(ReadOnlyArrays):
    """Linear system with one input and one output: ``dx/dt = A x + B u``, ``y = C x + D u``.

    Attributes:
        A: Shape ``(n, n)``.
        B: Shape ``(n,)``.
        C: Shape ``(n,)``.
        D: Feed-through; a device with mass at its motor has none.
    """

    A: Float[Array, "n n"]
    B: Float[Array, " n"]
    C: Float[Array, " n"]
    D: float = 0.0


@runtime_checkable
class Axis(Protocol):
    """One axis of a haptic device, from motor force [N or N m] to motor position [m or rad]."""

    @property
    def transfer_function(self) -> TransferFunction:
        """Position over force."""
        ...

    @property
    def state_space(self) -> StateSpace:
        """The same with states."""
        ...


@dataclass(frozen=True)
class TransferFunction(ReadOnlyArrays):
    """Position over force as a fraction of two polynomials of s, highest power first.

    Attributes:
        numerator: Shape ``(m,)``.
        denominator: Shape ``(n,)``, ``n >= m``.

    Raises:
        ParameterError: If the numerator has the higher degree, or a leading coefficient is zero or not finite.
    """

    numerator: Float[Array, " m"]
    denominator: Float[Array, " n"]

    def __post_init__(self):
        super().__post_init__()
        for name in ("numerator", "denominator"):
            values = getattr(self, name)
            if not (values.ndim == 1 and len(values) and np.all(np.isfinite(values)) and values[0] != 0):
                raise ParameterError(
                    f"The {name} of a transfer function is {values.tolist()}: give finite coefficients, "
                    "the highest power of s first and not zero."
                )
        if len(self.numerator) > len(self.denominator):
            raise ParameterError(
                f"A transfer function of degree {len(self.numerator) - 1} over {len(self.denominator) - 1} was given: "
                "no device answers force with position faster than at once, give a numerator of lower degree."
            )

    @property
    def transfer_function(self) -> TransferFunction:
        """Itself, so that it serves wherever an axis does."""
        return self

    @property
    def poles(self) -> Complex[Array, " k"]:
        """Roots of the denominator [rad/s]."""
        return np.roots(self.denominator).astype(complex)

    @property
    def zeros(self) -> Complex[Array, " k"]:
        """Roots of the numerator [rad/s]."""
        return np.roots(self.numerator).astype(complex)

    def response(self, frequency: Float[Array, " k"]) -> Complex[Array, " k"]:
        """Position over force at the frequencies [rad/s], shape ``(k,)``."""
        s = 1j * frequency
        return np.polyval(self.numerator, s) / np.polyval(self.denominator, s)

    @property
    def state_space(self) -> StateSpace:
        """Observer form, in the time scale of the fastest root so that no state dwarfs another.

        Raises:
            ParameterError: If it is a bare spring, which has no state.
        """
        order = len(self.denominator) - 1
        if order == 0:
            raise ParameterError(
                "A transfer function without any power of s has no state: give a device with a mass or a damper."
            )
        roots = np.abs(np.concatenate([self.poles, self.zeros]))
        scale = float(roots.max()) if len(roots) and roots.max() > 0 else 1.0
        powers = scale ** np.arange(order, -1.0, -1.0)
        lead = self.denominator[0] * powers[0]
        below = self.denominator * powers / lead
        above = np.zeros(order + 1)
        above[order + 1 - len(self.numerator) :] = self.numerator
        above = above * powers / lead
        A = np.eye(order, k=1)
        A[:, 0] = -below[1:]
        C = np.zeros(order)
        C[0] = 1.0
        return StateSpace(scale * A, scale * (above[1:] - above[0] * below[1:]), C, float(above[0]))

    def plus(self, compliance: float) -> TransferFunction:
        """The same device behind a spring of this compliance [m/N], as seen by who pushes the spring."""
        wide = np.zeros(len(self.denominator))
        wide[len(self.denominator) - len(self.numerator) :] = self.numerator
        return TransferFunction(np.trim_zeros(wide + compliance * self.denominator, "f"), self.denominator)
