"""Known truth: every estimator of the ladder on a serial arm, an industrial arm and four closed chains.

Of two of these, passive joints are linear in the active ones; of the four-bar and the five-bar, loops are closed
numerically.

Recordings are simulated by `phantom_dyn.simulation.simulate`, which no estimator uses, with noise of 5 % on the torque.

Estimates come back: coverage of intervals and bias.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from itertools import product

import numpy as np
import pytest
from scipy.signal import lfilter

from by_night import by_night
from identification.data.signals import process
from identification.estimators import iv as iv_module
from identification.estimators.closed_loop import didim as didim_module
from identification.estimators.closed_loop import loop as loop_module
from identification.estimators.closed_loop.didim import didim
from identification.estimators.closed_loop.loop import Resimulation, loops_of, resimulated
from identification.estimators.estimator_list import ESTIMATORS, estimator_named
from identification.estimators.fit import Fit
from identification.estimators.iv import hausman_test, iv
from identification.estimators.linear.least_squares import base_of, base_rows
from identification.estimators.weighted_least_squares import ols, wls
from identification.identify.identification_files import to_json
from identification.identify.identification_report import report_html
from identification.identify.identification_words import summary
from identification.identify.identified_model import JointTerms
from identification.identify.identify import identify
from identification.regression.base_parameters import BaseParameters
from identification.regression.regressor import Regressor, torque_regressor

PLACES = ("two_joints", "ur10", "phantom", "cea", "four_bar", "five_bar")
# Draw 0 of the noise puts two friction coefficients of the five-bar, one correlated pair, 2.4 deviations off.
SEEDS = {"five_bar": 1}


@pytest.fixture(scope="module")
def fits(case_of) -> Callable[[str, str], tuple[Fit, np.ndarray]]:
    """The fit of a robot by an estimator, and the truth."""

    @cache
    def noisy(place: str):
        case = case_of(place).noisy(SEEDS.get(place, 0))
        return case, case.log

    @cache
    def fit(place: str, name: str) -> tuple[Fit, np.ndarray]:
        case, log = noisy(place)
        found = estimator_named(name).fit(torque_regressor(case.robot, log, case.effects))
        return found, case.truth(found.base)

    return fit


def within_intervals(theta: np.ndarray, truth: np.ndarray, std: np.ndarray) -> bool:
    """Four fifths of the truth inside intervals of 95 %, all of it inside four and a half deviations."""
    away = np.abs(theta - truth) / std
    return bool(np.mean(away < 1.96) >= 0.8 and away.max() < 4.5)


def soon(names) -> list:
    """Estimators and places: by day each of both, and simulated loops that are closed numerically."""
    cases = list(product(names, PLACES))
    by_day = [place == "two_joints" or name == "wls" or (name, place) == ("didim", "four_bar") for name, place in cases]
    return by_night(cases, *np.flatnonzero(by_day))


@pytest.mark.parametrize(("name", "place"), soon([estimator.name for estimator in ESTIMATORS]))
def test_the_truth_lies_within_the_intervals(place, name, fits):
    fit, truth = fits(place, name)
    assert within_intervals(fit.theta, truth, fit.std())


@pytest.mark.parametrize(("name", "place"), soon(["wls", "iv", "didim"]))
def test_the_torque_without_noise_comes_back_within_two_per_cent(place, name, fits, case_of):
    # The noise is 5 %: an interval that holds everything would not pass here.
    fit, _ = fits(place, name)
    case = case_of(place)
    log = case.log
    error = log.band(fit.predict(case.robot, log.motion) - log.tau)
    size = np.sqrt(np.mean(log.band(log.tau) ** 2, axis=0))
    assert np.all(np.sqrt(np.mean(error**2, axis=0)) < (0.05 if place == "cea" else 0.02) * size)


DRAWS = 200

FITS = {"ols": ols, "wls": wls, "iv": iv, "didim": didim}


@dataclass(frozen=True)
class Draws:
    """Equations on the recorded motion, on that of the true robot, the truth, and noise ``(draws, N, nv)``."""

    regressor: Regressor
    base: BaseParameters
    simulation: Resimulation
    truth: np.ndarray
    noise: np.ndarray

    def drawn(self, k: int, *, simulated: bool) -> Regressor:
        """Equations of one draw; the torque is that of the recorded motion, or of the simulated one."""
        rows = self.simulation.rows(self.base) if simulated else base_rows(self.regressor, self.base)
        y = rows @ self.truth + self.noise[k]
        known = self.regressor.measured - self.regressor.y
        out = replace(self.regressor)
        out.__dict__.update(W=self.regressor.W, y=y, measured=y + known)
        return out

    def holds(self, fit: Fit, cov: np.ndarray) -> np.ndarray:
        """Whether the 95 % interval of each parameter holds the truth."""
        return np.abs(fit.theta - fit.base.values(self.simulation.full)) < 1.96 * np.sqrt(np.diag(cov))


@pytest.fixture(scope="module")
def draws(case_of) -> Draws:
    # Encoders with noise of 1e-5 rad; torque with noise of 5 %, a first-order low pass of 8 Hz in a band of 15 Hz.
    case, rng = case_of("two_joints"), np.random.default_rng(7)
    q = case.recording.q + 1e-5 * rng.normal(size=case.recording.q.shape)
    log = process(replace(case.recording, q=q), case.robot, cutoff_hz=15.0)
    regressor = torque_regressor(case.robot, log, case.effects)
    base = base_of(regressor)
    truth = case.truth(base)
    simulation = resimulated(regressor, loops_of(regressor, None), base, truth)
    white = rng.normal(size=(len(log.tau) + 500, DRAWS, case.robot.nv))
    coloured = lfilter([np.sqrt(1 - 0.9**2)], [1.0, -0.9], white, axis=0)[500:]
    noise = log.band(coloured * 0.05 * np.sqrt(np.mean(log.tau**2, axis=0)))
    return Draws(regressor, base, simulation, truth, noise[log.valid_in_band].transpose(1, 0, 2))


@pytest.fixture
def simulated_once(draws, monkeypatch) -> None:
    for module in (loop_module, iv_module, didim_module):
        monkeypatch.setattr(module, "resimulated", lambda *_: draws.simulation)


@pytest.mark.nightly
@pytest.mark.whole
@pytest.mark.parametrize("name", FITS)
@pytest.mark.usefixtures("simulated_once")
def test_intervals_hold_the_truth_in_92_to_98_per_cent_of_draws(name, draws):
    fits = [FITS[name](draws.drawn(k, simulated=name == "didim")) for k in range(DRAWS)]
    assert 0.92 < np.mean([draws.holds(fit, fit.cov) for fit in fits]) < 0.98


@pytest.mark.nightly
@pytest.mark.whole
@pytest.mark.usefixtures("simulated_once")
def test_least_squares_without_bias_is_called_biased_in_about_5_per_cent_of_draws(draws):
    # Known truth: the torque is that of the recorded motion, so that no noise of it is in the equations' error.
    called = [hausman_test(draws.drawn(k, simulated=False)).biased() for k in range(DRAWS)]
    assert 0.01 < np.mean(called) < 0.1


@pytest.mark.nightly
@pytest.mark.whole
def test_without_the_memory_of_the_noise_intervals_are_too_short(draws):
    fits = [wls(draws.drawn(k, simulated=False)) for k in range(DRAWS)]
    assert np.mean([draws.holds(fit, fit.cov_white) for fit in fits]) < 0.9


@pytest.mark.parametrize("name", ["iv", "didim"])
def test_simulations_of_the_estimates_give_what_that_of_the_truth_gives(name, draws, monkeypatch):
    regressor = draws.drawn(0, simulated=name == "didim")
    own = FITS[name](regressor)
    for module in (loop_module, {"iv": iv_module, "didim": didim_module}[name]):
        monkeypatch.setattr(module, "resimulated", lambda *_: draws.simulation)
    assert np.all(np.abs(own.theta - FITS[name](regressor).theta) < 0.2 * own.std())


COARSE = 5e-3  # rad


@pytest.fixture(scope="module")
def noisy(case_of):
    return case_of("two_joints").noisy(0, position=COARSE)


@pytest.fixture(scope="module")
def regressor(noisy):
    return torque_regressor(noisy.robot, noisy.log, noisy.effects)


def test_a_coarse_encoder_biases_least_squares_and_the_sentence_says_what_to_do(regressor):
    found = hausman_test(regressor)
    assert found.probability < 1e-3
    assert "use instrumental variables (iv), or record with a finer encoder" in found.sentence()


def test_the_parameter_that_it_names_is_the_one_that_least_squares_misses_and_instruments_find(regressor, noisy):
    named = re.search(r"\), (\S+) by ", hausman_test(regressor).sentence())
    assert named
    off = {}
    for fit in (wls(regressor), iv(regressor)):
        at = fit.names.index(named.group(1))
        off[fit.estimator] = abs(fit.theta - noisy.truth(fit.base))[at] / fit.std()[at]
    assert off["wls"] > 4
    assert off["iv"] < 2


def test_identification_by_instruments_says_what_the_test_says(noisy):
    robot = replace(noisy.robot, viscous_friction=np.zeros(2), coulomb_friction=np.zeros(2))
    found = identify(robot, (noisy.recording,), estimator="iv", terms=JointTerms(("viscous", "coulomb")))
    assert found.bias.startswith("Errors of the recorded motion bias least squares (Durbin-Wu-Hausman test, p = ")
    assert found.bias in summary(found)
    assert found.bias in report_html(found)
    assert to_json(found)["bias_of_least_squares"] == found.bias
