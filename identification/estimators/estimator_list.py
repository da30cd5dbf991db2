"""The list of estimators; a new estimator needs its own file and an entry in this list."""

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
    """A method that estimates parameters from recordings.

    Attributes:
        name: Name for ``--estimator``.
        fit: Function from equations to a fit.
        simulates: True if the estimator simulates the closed loop. It then needs references ``q_ref.<joint>`` in every
            log, and in ``robot.yaml`` a controller of every joint with a drive.
    """

    name: str
    fit: Callable[[Regressor], Fit]
    simulates: bool = False


ESTIMATORS: tuple[Estimator, ...] = (
    Estimator("ols", ols),  # ordinary least squares: all rows have the same weight
    Estimator("wls", wls),  # weighted least squares: each joint is weighted by its noise
    Estimator("irls", irls),  # robust least squares: the influence of outliers is bounded
    Estimator("consistent", consistent),  # weighted least squares with physically consistent parameters
    Estimator("iv", iv, simulates=True),  # instrumental variables: encoder noise causes no bias
    Estimator("didim", didim, simulates=True),  # the torque of a simulated loop is fitted to the measured one
)


def estimator_named(name: str) -> Estimator:
    """The estimator with this name.

    Raises:
        ParameterError: If there is none; the message lists the known names.
    """
    for estimator in ESTIMATORS:
        if estimator.name == name:
            return estimator
    known = ", ".join(estimator.name for estimator in ESTIMATORS)
    raise ParameterError(f"Unknown estimator '{name}': known estimators are {known}.")
