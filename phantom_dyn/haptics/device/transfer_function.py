"""Rational transfer functions from force to position, and their state space."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from phantom_dyn.array_types import Array, Complex, Float, ReadOnlyArrays
from phantom_dyn.errors import ParameterError


@dataclass(frozen=True)
class StateSpace(ReadOnlyArrays):
    """Linear system with one input and one output: ``dx/dt = A x + B u``, ``y = C x + D u``.

    Attributes:
        A: State matrix, shape ``(n, n)``.
        B: Input column, shape ``(n,)``.
        C: Output row, shape ``(n,)``.
        D: Feed-through; zero for a device with mass at its motor.
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
        """State space of the same system."""
        ...


@dataclass(frozen=True)
class TransferFunction(ReadOnlyArrays):
    """Position over force as a fraction of two polynomials of s, highest power first.

    Attributes:
        numerator: Coefficients, shape ``(m,)``.
        denominator: Coefficients, shape ``(n,)``, ``n >= m``.

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
                "no device moves before the force acts, give a numerator of lower degree."
            )

    @property
    def transfer_function(self) -> TransferFunction:
        """The function itself, so that it can be used as an axis."""
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
        """Observer form, scaled by the fastest root so that all states are of similar size.

        Raises:
            ParameterError: If it has no power of s, like the transfer function of a bare spring.
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
        """Position over force at the end of a spring of this compliance [m/N] between the force and the device."""
        wide = np.zeros(len(self.denominator))
        wide[len(self.denominator) - len(self.numerator) :] = self.numerator
        return TransferFunction(np.trim_zeros(wide + compliance * self.denominator, "f"), self.denominator)
