"""The list of estimators, from the simplest on: adding one touches its own file and this list."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from identification.estimators.closed_loop.cloe import fit_cloe
from identification.estimators.closed_loop.didim import fit_didim
from identification.estimators.consistent.consistent import fit_consistent
from identification.estimators.fit import Fit
from identification.estimators.iv import fit_iv
from identification.estimators.tls import fit_tls
from identification.estimators.weighted_least_squares import fit_irls, fit_ols, fit_wls
from phantom_dyn.errors import ParameterError

# References q_ref.<joint> in every log, a controller of every driven joint in robot.yaml (or ``feedback=``), a payload
# of known mass in at least one recording (``payloads=``).
Need = Literal["references", "controllers", "payload"]


@dataclass(frozen=True)
class Estimator:
    """One way from recordings to parameters.

    Attributes:
        name: As a user gives it.
        sentence: What it does and when to take it.
        fit: ``fit(robot, logs, effects)``; what it ``needs`` beyond them comes by keyword.
        needs: What a robot and its logs must state beside motion and torque.
    """

    name: str
    sentence: str
    fit: Callable[..., Fit]
    needs: tuple[Need, ...] = ()

    @property
    def plain(self) -> bool:
        """True if ``fit(robot, logs, effects)`` is enough of a call."""
        return "payload" not in self.needs


ESTIMATORS: tuple[Estimator, ...] = (
    Estimator("ols", "Ordinary least squares: every row counts the same.", fit_ols),
    Estimator("wls", "Weighted least squares: every joint counts by its own noise.", fit_wls),
    Estimator("irls", "Robust least squares (Huber): outliers are bounded in their pull.", fit_irls),
    Estimator(
        "consistent",
        "Weighted least squares whose bodies could exist: mass, inertia and friction that no physics forbids.",
        fit_consistent,
    ),
    Estimator(
        "tls",
        "Total least squares with the gain of every drive, scaled by a payload of known mass.",
        fit_tls,
        ("payload",),
    ),
    Estimator(
        "iv",
        "Instrumental variables: noise of the encoders does not bias it.",
        fit_iv,
        ("references", "controllers"),
    ),
    Estimator(
        "didim",
        "Direct and inverse: the torque of a simulated closed loop is fitted to the measured one.",
        fit_didim,
        ("references", "controllers"),
    ),
    Estimator(
        "cloe",
        "Closed-loop output error: simulated torques and positions are fitted, with the states at the start.",
        fit_cloe,
        ("references", "controllers"),
    ),
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
