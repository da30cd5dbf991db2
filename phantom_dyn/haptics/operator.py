"""The hand that holds a haptic device: a mass on a spring and a damper."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float

from phantom_dyn.errors import ParameterError

Array = np.ndarray


@dataclass(frozen=True)
class Operator:
    r"""Impedance of a human operator, force over position: :math:`Z_h(s) = m_h s^2 + b_h s + k_h`.

    Equation (30) of Gil et al. (2010, "Advances in Haptics", chapter on stability and transparency).

    Attributes:
        mass: :math:`m_h` [kg, or kg m2 about a joint].
        damping: :math:`b_h` [N s/m, or N m s/rad].
        stiffness: :math:`k_h` [N/m, or N m/rad].

    Raises:
        ParameterError: If a value is negative or not finite.
    """

    mass: float
    damping: float
    stiffness: float

    def __post_init__(self) -> None:
        for name, value in (("mass", self.mass), ("damping", self.damping), ("stiffness", self.stiffness)):
            if not (math.isfinite(value) and value >= 0):
                raise ParameterError(f"The operator's {name} is {value}: give a number of 0 or more.")

    def polynomial(self) -> Float[Array, "3"]:
        """Coefficients of the impedance in falling powers of s, ``[m_h, b_h, k_h]``."""
        return np.array([self.mass, self.damping, self.stiffness], dtype=np.float64)

    def impedance(self, frequency: Float[Array, " n"]) -> Complex[Array, " n"]:
        """Force over position [N/m] at the frequencies [rad/s], shape ``(n,)``."""
        return np.polyval(self.polynomial(), 1j * frequency)


FREE_HAND = Operator(0.0, 0.0, 0.0)
"""Nobody holds the device."""

YOKOKOHJI_YOSHIKAWA = Operator(2.0, 2.0, 10.0)
"""2 kg, 2 N s/m, 10 N/m, as commonly cited after Yokokohji and Yoshikawa (1994).

The chapter takes its operator from there without printing numbers, so these are no data of the chapter.
"""
