"""Known truth: noise of an encoder biases least squares, which the Durbin-Wu-Hausman test tells."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from identification.estimators.iv import hausman_test, iv
from identification.estimators.weighted_least_squares import wls
from identification.identify.identification_files import to_json
from identification.identify.identification_report import report_html
from identification.identify.identification_words import summary
from identification.identify.identified_model import JointTerms
from identification.identify.identify import identify
from identification.regression.regressor import torque_regressor

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
