"""What a judgement puts together. Oracle: by hand on made-up sums, joints and recordings."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from identification.diagnosis.fit.gap import Sums
from identification.diagnosis.judge import judgement
from identification.diagnosis.judge.floors import Floor
from identification.diagnosis.judge.judged_band import Judge
from identification.diagnosis.judge.judgement import _less, _located, _timed, evidence_of, joint_gaps
from identification.diagnosis.judge.regimes import regime_split
from identification.diagnosis.result import Burst, JointGap, Unexplained

CLEAN = Unexplained(0.2, False, None, None)
HERE = Unexplained(0.2, True, "shoulder", "posture")


def test_coarse_readings_take_their_mean_square_off_each_block_and_no_more_than_is_there():
    found = Sums(np.array([[8.0, 5.0], [3.0, 9.0]]), np.array([[10.0, 20.0], [30.0, 40.0]]))
    left = _less(found, np.array([0.2, 0.1]))
    np.testing.assert_allclose(left.squares, [[6.0, 3.0], [0.0, 5.0]])
    np.testing.assert_array_equal(left.counts, found.counts)


def joint(name: str, after: float, floor: float, high: float) -> JointGap:
    return JointGap(name, "N m", 9.0, after, floor, 100, noise_floor_interval=(0.5 * floor, high))


@pytest.mark.parametrize(
    ("after", "expected"),
    # By hand: residuals over upper ends of floors of 1 and 4.
    [((1.5, 5.0), "shoulder"), ((1.2, 5.0), "elbow"), ((1.0, 4.0), None), ((0.5, 4.1), "elbow")],
)
def test_what_is_left_is_located_on_the_joint_furthest_above_its_floor(quiet, after, expected):
    joints = (joint("shoulder", after[0], 0.9, 1.0), joint("elbow", after[1], 3.0, 4.0))
    residual = quiet.columns.residual
    found = _located(CLEAN, quiet.problem, residual, joints)
    row = None if expected is None else ("shoulder", "elbow").index(expected)
    regime = None if row is None else regime_split(quiet.problem, residual, row).best
    assert found == replace(CLEAN, joint=expected, regime=regime)


def test_a_structure_that_is_located_stays_where_it_is(quiet):
    joints = (joint("shoulder", 1.0, 0.9, 1.0), joint("elbow", 9.0, 3.0, 4.0))
    assert _located(HERE, quiet.problem, quiet.columns.residual, joints) is HERE


def test_events_say_their_times_and_where_the_largest_is():
    bursts = (Burst("a", "elbow", 1.0, 1.5, 9.0, 7.0), Burst("a", "wrist", 3.0, 3.2, 1.0, 8.0))
    times = ((1.0, 1.5), (3.0, 3.2))
    assert _timed(CLEAN, bursts) == replace(CLEAN, joint="wrist", times=times)
    assert _timed(HERE, bursts) == replace(HERE, times=times)
    assert _timed(CLEAN, ()) is CLEAN


def alike(rms: tuple[float, float], counts: tuple[float, float] = (64.0, 16.0)) -> Sums:
    """Residuals of this size in four blocks of so many samples of each joint."""
    every = np.tile(counts, (4, 1))
    return Sums(np.square(rms) * every, every)


@pytest.mark.parametrize(("within", "closed"), [(0.25, None), (0.5, (0.25 - 0.015625) / (0.25 - 0.0625))])
def test_a_joint_has_a_gap_from_above_the_upper_end_of_its_floor(quiet, within, closed):
    # By hand: floors of a quarter and their ends; all squares are powers of two.
    floor = Floor(np.array([0.25, 0.5]), np.array([0.125, 0.5]), np.array([0.25, 1.0]), ("above_band", "predictors"))
    first, second = joint_gaps(quiet.problem, floor, alike((1.0, 2.0)), alike((within, 1.0)), alike((0.125, 0.5)))
    assert first.closed == (None if closed is None else pytest.approx(closed))
    assert second.closed is None
    assert (first.noise_floor, second.noise_floor) == (0.25, 0.5)
    assert (first.hold_out_samples, second.hold_out_samples) == (256, 64)
    assert (second.rms_before, second.rms_within_tolerance, second.rms_after) == (2.0, 1.0, 0.5)
    assert second.noise_floor_interval == (0.5, 1.0)
    assert (first.noise_floor_source, second.noise_floor_source) == ("above_band", "predictors")
    assert (first.unit, first.joint, second.joint) == ("N m", "shoulder", "elbow")


def test_the_measured_torque_of_a_joint_is_what_the_model_needs_and_what_it_leaves(quiet):
    columns = quiet.columns
    problem = replace(quiet.problem, session=replace(quiet.session, cutoff_hz=1e3))
    floor = Floor(np.ones(2), np.ones(2), np.ones(2), ("predictors",) * 2)
    gaps = joint_gaps(problem, floor, alike((1.0, 1.0)), alike((1.0, 1.0)), alike((1.0, 1.0)))
    use = np.concatenate([np.arange(block.core, block.stop) for block in quiet.blocks])
    torque = (columns.model_torque[0] + columns.residual[0])[use]
    assert [gap.rms_torque for gap in gaps] == pytest.approx(np.sqrt(np.mean(torque**2, axis=0)))


@pytest.fixture
def evidence(quiet):
    """Two logs of one motion, the second one later and half as fast, judged as a whole; and what was put in."""
    columns, log = quiet.columns, quiet.logs[0]
    names = ("values", "residual", "model_torque", "usable", "doubt", "standing", "operations")
    columns = replace(columns, **{name: 2 * getattr(columns, name) for name in names})
    slow = replace(log.motion, t=3.0 + 2.0 * log.motion.t)
    other = replace(log, motion=slow, band=replace(log.band, rate_hz=0.5 * log.band.rate_hz))
    session = replace(quiet.session, cutoff_hz=1e3, logs=(log, other))
    problem = replace(quiet.problem, session=session, columns=columns)
    series = [tuple(np.random.default_rng(k).normal(size=(2, *columns.residual[0].shape))) for k in range(3)]
    return problem, series, evidence_of(Judge(problem, np.ones(2), np.ones(2)), series[0], series[1], (series[2],))


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
    passed = [o.transmitted - o.own_friction for o in columns.operations]
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


@pytest.mark.parametrize(("above", "searched"), [(True, True), (False, False)])
def test_what_the_judged_band_shows_is_looked_for_there_where_nothing_was_found(quiet, monkeypatch, above, searched):
    # By hand: the search has found nothing, and finds an offset in the judged band if more than noise is left there.
    offset, asked = frozenset([quiet.term("torque_offset", "elbow")]), []

    def shown(bench, state):
        asked.append(state.found)
        return SimpleNamespace(chosen=state.found)

    monkeypatch.setattr(judgement, "shown_effects", shown)
    monkeypatch.setattr(judgement, "in_band", lambda bench, state: state)
    monkeypatch.setattr(judgement, "_left", lambda *_: SimpleNamespace(judge=None))
    monkeypatch.setattr(judgement, "_with_foreseen_noise", lambda left, *_: left)
    monkeypatch.setattr(judgement, "_above_noise", lambda left: above)
    monkeypatch.setattr(judgement, "_torque_over_noise", lambda left: 2.0)
    monkeypatch.setattr(judgement, "explain", lambda plain, progress: offset)
    judgement._shown_above_noise(SimpleNamespace(search=quiet.search, chosen=frozenset()), quiet.search, ())
    assert asked == [offset if searched else frozenset()]


def test_nothing_is_shown_where_the_torque_is_within_its_noise(quiet, monkeypatch):
    # By hand: nine tenths of the noise.
    offset = quiet.term("torque_offset", "elbow")
    monkeypatch.setattr(judgement, "shown_effects", lambda bench, state: SimpleNamespace(chosen=state.found))
    monkeypatch.setattr(judgement, "in_band", lambda bench, state: state)
    monkeypatch.setattr(judgement, "replace", lambda left, **_: left)
    monkeypatch.setattr(judgement, "_left", lambda *_: SimpleNamespace(judge=None, floor=None))
    monkeypatch.setattr(judgement, "_with_foreseen_noise", lambda left, *_: left)
    monkeypatch.setattr(judgement, "_torque_over_noise", lambda left: 0.9)
    search = quiet.search
    shown, _ = judgement._shown_above_noise(SimpleNamespace(search=search, chosen=frozenset([offset])), search, ())
    assert shown.chosen == frozenset()
    (result,) = search.record.met(offset.place)
    assert (result.gate, result.value, result.needed, result.passed) == ("torque is there", 0.9, 1.0, False)
