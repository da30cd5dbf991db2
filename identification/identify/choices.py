"""The estimators that a user can name."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from identification.estimators.fit import Fit
from identification.estimators.irls import fit_irls
from identification.estimators.ols import fit_ols
from identification.estimators.wls import fit_wls
from identification.log import Log
from identification.regressor import EffectOnJoint
from phantom_dyn.errors import UsageError
from phantom_dyn.naming import known_names
from phantom_dyn.robot import Robot

DEFAULT = "wls"


@dataclass(frozen=True)
class Choice:
    """An estimator with its name and one sentence on it."""

    name: str
    words: str
    fit: Callable[[Robot, Sequence[Log], Sequence[EffectOnJoint]], Fit]


CHOICES = (
    Choice("ols", "Ordinary least squares: every sample of every joint counts the same.", fit_ols),
    Choice("wls", "Weighted least squares: every joint counts by its noise.", fit_wls),
    Choice("irls", "Robust least squares: samples far outside the noise count less.", fit_irls),
)


def choice_named(name: str) -> Choice:
    """The estimator of that name.

    Raises:
        UsageError: If there is none; the text lists the known names.
    """
    for choice in CHOICES:
        if choice.name == name:
            return choice
    known = known_names(name, [choice.name for choice in CHOICES], "estimators")
    raise UsageError(f"--estimator {name} is unknown, {known}")
