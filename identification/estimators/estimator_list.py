"""The list of estimators, from the simplest on: adding one touches its own file and this list."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from identification.estimators.closed_loop.didim import didim
from identification.estimators.consistent.consistent import consistent
from identification.estimators.fit import Fit
from identification.estimators.iv import iv
from identification.estimators.weighted_least_squares import irls, ols, wls
from identification.regression.regressor import Regressor
from phantom_dyn.errors import ParameterError


@dataclass(frozen=True)
class Estimator:
    """One way from recordings to parameters.

    Attributes:
        name: The one that a user gives.
        fit: Takes the equations.
        simulates: True if it simulates the closed loop: every log has references ``q_ref.<joint>``, and ``robot.yaml``
            states a controller of every driven joint.
    """

    name: str
    fit: Callable[[Regressor], Fit]
    simulates: bool = False


ESTIMATORS: tuple[Estimator, ...] = (
    Estimator("ols", ols),  # every row counts the same
    Estimator("wls", wls),  # every joint counts by its own noise
    Estimator("irls", irls),  # outliers are bounded in their pull
    Estimator("consistent", consistent),  # as wls, with bodies and friction that can exist
    Estimator("iv", iv, simulates=True),  # noise of the encoders does not bias it
    Estimator("didim", didim, simulates=True),  # the torque of a simulated loop is fitted to the measured one
)


def estimator_named(name: str) -> Estimator:
    """The estimator of that name.

    Raises:
        ParameterError: If there is none; the text lists the known names.
    """
    for estimator in ESTIMATORS:
        if estimator.name == name:
            return estimator
    known = ", ".join(estimator.name for estimator in ESTIMATORS)
    raise ParameterError(f"Unknown estimator '{name}': known estimators are {known}.")
