"""Samples of torque and motion behind a diagnosis. Oracle: two logs of one motion, put in by hand."""

from dataclasses import replace

import numpy as np
import pytest

from identification.diagnosis.judge.evidence_samples import evidence_of
from identification.diagnosis.judge.judged_band import JudgedBand
from identification.diagnosis.judge.regimes import regime_split


@pytest.fixture
def evidence(quiet):
    """Two logs of one motion, the second one later and half as fast, judged as a whole; and what was put in."""
    columns, log = quiet.columns, quiet.logs[0]
    names = ("values", "residual", "model_torque", "usable", "reversal_std", "standstill_std", "operations")
    columns = replace(columns, **{name: 2 * getattr(columns, name) for name in names})
    slow = replace(log.motion, t=3.0 + 2.0 * log.motion.t)
    other = replace(log, motion=slow, band=replace(log.band, rate_hz=0.5 * log.band.rate_hz))
    session = replace(quiet.session, cutoff_hz=1e3, logs=(log, other))
    problem = replace(quiet.problem, session=session, columns=columns)
    series = [tuple(np.random.default_rng(k).normal(size=(2, *columns.residual[0].shape))) for k in range(3)]
    return problem, series, evidence_of(JudgedBand(problem, np.ones(2), np.ones(2)), series[0], series[1], (series[2],))


def test_evidence_is_of_one_recording_after_the_other_with_a_second_between(evidence):
    problem, _, found = evidence
    t = [log.motion.t[log.samples] for log in problem.session.logs]
    count = len(t[0])
    np.testing.assert_allclose(found.t[:count], t[0] - t[0][0])
    np.testing.assert_allclose(found.t[count:], t[1] - t[1][0] + found.t[count - 1] + 1.0)


def test_evidence_holds_the_torques_as_they_were_measured_modelled_and_corrected(evidence):
    problem, series, found = evidence
    columns = problem.columns
    np.testing.assert_allclose(found.tau_before, np.concatenate(columns.model_torque))
    measured = [model + rest for model, rest in zip(columns.model_torque, columns.residual, strict=True)]
    np.testing.assert_allclose(found.tau_measured, np.concatenate(measured))
    np.testing.assert_array_equal(found.tau_after, np.concatenate(series[1]))
    np.testing.assert_array_equal(found.tau_without[0], np.concatenate(series[2]))
    passed = [o.transmitted for o in columns.operations]
    banded = [log.band(torque) for log, torque in zip(problem.session.logs, passed, strict=True)]
    np.testing.assert_allclose(found.tau_transmitted, np.concatenate(banded))


def test_evidence_splits_the_given_residual_over_regimes(evidence):
    problem, series, found = evidence
    splits = [regime_split(problem, series[0], row) for row in range(2)]
    assert found.regime_shares == tuple(split.shares for split in splits)
    assert found.regime_times == tuple(split.times for split in splits)


def test_the_sample_period_of_several_recordings_is_that_of_their_median_rate(evidence):
    # By hand: 200 and 100 Hz.
    assert evidence[2].sample_period == pytest.approx(1.0 / 150.0)
