"""Fits the Coulomb friction of a joint as a linear function of the pretension of its cable.

The Coulomb torques of one joint at several pretensions, with their standard deviations, come from
`identification.experiments.constant_speed_friction`. The intercept of the line is the friction of bearings and seals.
If the intercept is not significant, friction is proportional to the pretension, as the CEA paper assumes (section V.B).
A line through the origin is therefore fitted as well.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import IdentifiabilityError, ParameterError

_SIGNIFICANT = 2.0
"""An intercept is significant if it is at least this many standard deviations from zero."""
_LEAST_DIFFERENCE = 1e-6
"""Least difference between the pretensions, as a share of the largest one."""


@dataclass(frozen=True)
class PretensionFit:
    """Fitted lines of the Coulomb torque over the pretension.

    Attributes:
        ratio: Slope of the line, torque per pretension [m], and its standard deviation.
        rest: Intercept of the line, the torque without pretension [N m], and its standard deviation.
        through_origin: Slope of a line through the origin [m], and its standard deviation.
        misfit: Mean square of the residuals of the line, in standard deviations; NaN for two pretensions.
    """

    ratio: tuple[float, float]
    rest: tuple[float, float]
    through_origin: tuple[float, float]
    misfit: float

    @property
    def proportional(self) -> bool:
        """True if the intercept is not significant."""
        return abs(self.rest[0]) < _SIGNIFICANT * self.rest[1]


def fit_pretension(
    pretension: Float[Array, " n"], coulomb: Float[Array, " n"], std: Float[Array, " n"]
) -> PretensionFit:
    """Line of the Coulomb torque over the pretension, by weighted least squares.

    Args:
        pretension: Pretension of the cable in each test [N], shape ``(n,)``.
        coulomb: Coulomb torque from each test [N m], shape ``(n,)``.
        std: Standard deviation of each Coulomb torque [N m], shape ``(n,)``.

    Raises:
        ParameterError: If the columns differ in length, or a number is not finite and above 0.
        IdentifiabilityError: If there are not two different pretensions.
    """
    for name, values in (("pretension", pretension), ("Coulomb torque", coulomb), ("deviation", std)):
        if np.shape(values) != np.shape(pretension) or not (np.isfinite(values) & (values > 0)).all():
            raise ParameterError(
                f"The {name} of the tests is {np.asarray(values).tolist()}: give one number above 0 for each of "
                f"{len(pretension)} tests."
            )
    if len(pretension) < 2 or np.ptp(pretension) < _LEAST_DIFFERENCE * pretension.max():
        raise IdentifiabilityError(
            f"Friction was tested at {len(pretension)} pretensions that do not differ: test it at two or more."
        )
    (slope, rest), cov = np.polyfit(pretension, coulomb, 1, w=1.0 / std, cov="unscaled")
    slope_std, rest_std = np.sqrt(np.diag(cov))
    square = float(np.sum((pretension / std) ** 2))
    squares = np.sum(((coulomb - rest - slope * pretension) / std) ** 2)
    return PretensionFit(
        ratio=(float(slope), float(slope_std)),
        rest=(float(rest), float(rest_std)),
        through_origin=(float(np.sum(pretension * coulomb / std**2)) / square, 1.0 / math.sqrt(square)),
        misfit=float(squares / (len(pretension) - 2)) if len(pretension) > 2 else math.nan,
    )
