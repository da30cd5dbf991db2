r"""Dry friction of a cable transmission, proportional to the pretension of its cable.

The source (section V.B) assumes of its capstans that "if the pretension of cable varies, then the Coulomb and stiction
coefficients vary linearly with respect to it", that the pretension "can not be null", and that stiction and Coulomb
friction are close. With a pretension P [N] of the cable of a joint,

.. math:: \Gamma_c(P) = r\,P, \qquad \Gamma_s(P) = \kappa\, r\,P, \quad \kappa \ge 1.

The ratio r is a length, the effective radius of friction: Coulomb torque per newton of pretension. The source publishes
no pretensions, so r is not known for its Coulomb torques. `rescaled` needs no r: it computes how friction changes when
the cable is tightened or slackens. `identification.experiments.cable_pretension` estimates r from tests, and tests
whether friction is proportional to the pretension or only linear in it.

References:
    Section V.B of [CEA]_ (`phantom_dyn.devices.cea`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import ParameterError
from phantom_dyn.number_checks import require_positive


@dataclass(frozen=True)
class CableFriction:
    """Dry friction of a joint that a pretensioned cable drives.

    Attributes:
        ratio: Coulomb torque per pretension, r [m]; for a linear joint, Coulomb force per pretension [1].

    Raises:
        ParameterError: If the ratio is not above 0.
    """

    ratio: float

    def __post_init__(self) -> None:
        require_positive(friction_per_pretension=self.ratio)

    def coulomb(self, pretension: Float[Array, " n"]) -> Float[Array, " n"]:
        """Coulomb torque at the pretensions [N m], shape ``(n,)``.

        Raises:
            ParameterError: If a pretension is not above 0: a slack cable drives nothing.
        """
        pulled = np.asarray(pretension, dtype=float)
        bad = np.flatnonzero(~(np.isfinite(pulled) & (pulled > 0)))
        if len(bad):
            raise ParameterError(
                f"Pretension number {bad[0]} is {pulled[bad[0]]:g} N: give one above 0, a slack cable drives nothing."
            )
        return self.ratio * pulled


def rescaled(coulomb: float, *, pretension: float, new_pretension: float) -> float:
    """Coulomb torque [N m] at a new pretension; the torque is proportional to the pretension.

    Args:
        coulomb: Coulomb torque at the old pretension [N m].
        pretension: The old pretension [N].
        new_pretension: The new pretension [N].

    Raises:
        ParameterError: If torque or a pretension is not above 0.
    """
    require_positive(pretension=pretension, new_pretension=new_pretension, Coulomb_torque=coulomb)
    return coulomb * new_pretension / pretension
