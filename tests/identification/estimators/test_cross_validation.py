from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

import identification.regression.regressor
from identification.data.log import Log
from identification.data.signals import low_pass
from identification.estimators.cross_validation import cross_validate, cross_validation_error
from identification.estimators.weighted_least_squares import fit_ols
from identification.regression.regressor import torque_regressor
from phantom_dyn.errors import ParameterError


@pytest.fixture
def noisy(arm, swing, make_log, rubbing, rng) -> Log:
    motion = swing(arm, 600)
    return make_log(arm, motion, rubbing(arm, motion) + 0.1 * rng.normal(size=(600, 3)))


def test_a_perfect_model_has_no_error(arm, swing, make_log, rubbing, friction):
    motion = swing(arm, 400)
    log = make_log(arm, motion, rubbing(arm, motion))
    np.testing.assert_allclose(cross_validate(arm, log, friction(arm)), 0.0, atol=1e-6)


def test_it_is_the_error_of_fits_that_have_not_seen_the_fold(arm, noisy, friction):
    # Oracle: the same by plain least squares on the whole regressor.
    regressor = torque_regressor(arm, noisy, friction(arm))
    W, y = regressor.W, regressor.y
    residual = np.empty_like(y)
    for fold in np.array_split(np.arange(600), 4):
        rest = np.delete(np.arange(600), fold)
        theta = np.linalg.lstsq(W[rest].reshape(-1, W.shape[2]), y[rest].ravel(), rcond=1e-9)[0]
        residual[fold] = y[fold] - W[fold] @ theta
    expected = 100 * np.linalg.norm(residual, axis=0) / np.linalg.norm(noisy.tau, axis=0)
    np.testing.assert_allclose(cross_validate(arm, noisy, friction(arm), folds=4), expected, rtol=1e-4)


def test_it_is_larger_than_the_error_of_the_fit(arm, noisy, friction):
    assert np.all(cross_validate(arm, noisy, friction(arm)) > fit_ols(arm, noisy, friction(arm)).relative_error)


def test_a_missing_effect_shows(arm, noisy, friction):
    assert np.all(cross_validate(arm, noisy) > 1.5 * cross_validate(arm, noisy, friction(arm)))


def test_streaming_does_not_change_it(arm, noisy, friction, monkeypatch):
    whole = cross_validate(arm, noisy, friction(arm))
    monkeypatch.setattr(identification.regression.regressor, "WHOLE_LIMIT", 0)
    monkeypatch.setattr(identification.regression.regressor, "_BLOCK", 70)
    np.testing.assert_allclose(cross_validate(arm, noisy, friction(arm)), whole, rtol=1e-6)


def test_samples_within_reach_of_the_filter_are_not_trained_on(arm, noisy, friction):
    # Oracle: plain least squares without the fold and 2 * half / step samples on either side of it.
    band = low_pass(10.0, 100.0)
    log = Log("made", noisy.joint_names, noisy.motion, noisy.tau, band, noisy.valid)
    regressor = torque_regressor(arm, log, friction(arm))
    W, y = regressor.W, regressor.y
    guard, edges = 2 * band.half // band.step, np.linspace(0, len(y), 4).round().astype(int)
    residual = np.empty_like(y)
    for start, stop in pairwise(edges):
        rest = np.delete(np.arange(len(y)), np.arange(max(0, start - guard), min(len(y), stop + guard)))
        theta = np.linalg.lstsq(W[rest].reshape(-1, W.shape[2]), y[rest].ravel(), rcond=1e-9)[0]
        residual[start:stop] = y[start:stop] - W[start:stop] @ theta
    expected = 100 * np.linalg.norm(residual, axis=0) / np.linalg.norm(regressor.measured, axis=0)
    np.testing.assert_allclose(cross_validation_error(regressor, folds=3), expected, rtol=1e-3)


def test_more_folds_than_the_samples_allow_are_refused(arm, noisy):
    with pytest.raises(ParameterError, match="400 folds of 600 samples were asked for: take at least two folds"):
        cross_validate(arm, noisy, folds=400)


def test_folds_that_leave_nothing_to_train_on_are_refused(arm, noisy):
    log = Log("made", noisy.joint_names, noisy.motion, noisy.tau, low_pass(1.0, 100.0), noisy.valid)
    with pytest.raises(ParameterError, match="2 folds leave nothing to train on beside the filter's reach"):
        cross_validate(arm, log, folds=2)
