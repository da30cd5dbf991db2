"""Simulated motion along a whole recording. Oracles: known truth, and that every sample is in one stretch."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from identification.diagnosis.columns.terms import KnownEffect
from identification.rollout.simulated_models import known_causes, model_of
from identification.viewing.replayed_motion import replayed_motion, stretches
from phantom_dyn.model.robot import Controller


@pytest.fixture(scope="module")
def models(rubbing, lacking):
    return {
        "given model": model_of(rubbing.robot, ()),
        "corrected model": model_of(rubbing.robot, known_causes(rubbing.robot, (lacking,))),
    }


@given(arrays(bool, st.integers(1, 60)), st.integers(3, 12))
def test_stretches_are_all_that_is_valid_and_long_enough_in_order(valid, length):
    taken = np.zeros(len(valid), dtype=int)
    for start, stop in stretches(valid, length):
        taken[start:stop] += 1
        assert 3 <= stop - start < length + 3
    assert taken.max(initial=0) <= 1
    edges = np.flatnonzero(np.diff(np.concatenate([[False], valid, [False]])))
    wanted = np.zeros(len(valid), dtype=int)
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        wanted[start:stop] = stop - start >= 3
    np.testing.assert_array_equal(taken, wanted)


def test_the_true_model_moves_as_the_recording_and_the_given_one_does_not(rubbing, models):
    found = replayed_motion(rubbing.log, rubbing.states, models, (0.5,))
    given_error, true_error = (np.abs(q - rubbing.recording.q).max() for q in found.q)
    assert found.horizon_s == 0.5
    assert true_error < 0.005 < 0.02 < given_error


def test_each_stretch_starts_where_the_recording_is(rubbing, models):
    found = replayed_motion(rubbing.log, rubbing.states, models, (0.25,))
    starts = np.arange(0, len(rubbing.log.motion.t), 50)
    np.testing.assert_allclose(found.q[0][starts], rubbing.states.q[starts], atol=1e-12)
    assert np.abs(found.q[0][starts[1:] - 1] - rubbing.states.q[starts[1:] - 1]).max() > 0.005


def test_what_must_not_be_used_is_not_simulated(rubbing, models):
    t = rubbing.log.motion.t
    left_out = (t > 3.0) & (t < 4.0)
    found = replayed_motion(replace(rubbing.log, valid=~left_out), rubbing.states, models, (0.5,))
    assert np.isnan(found.q[0][left_out]).all()
    assert np.isfinite(found.q[0][~left_out]).all()


def test_under_the_stated_controllers_no_recorded_torque_is_used(rubbing, models):
    log = replace(rubbing.log, tau=np.full_like(rubbing.log.tau, np.nan))
    controller = {"kp": 200.0, "kd": 20.0}
    robot = _with_controllers(rubbing.robot, controller)
    model = model_of(robot, known_causes(robot, ()))
    found = replayed_motion(log, rubbing.states, {"given model": model}, (0.5,), controlled=True)
    assert np.isfinite(found.q[0]).all()


def test_a_controller_that_damps_a_light_link_is_followed_in_steps_that_are_short_enough(rubbing):
    # Closed form: a link of inertia I under the damping kd loses its speed at the rate kd / I, which steps of 1 ms
    # cannot follow beyond 2 I / kd.
    robot = _with_controllers(rubbing.robot, {"kp": 200.0, "kd": 100.0})
    found = replayed_motion(rubbing.log, rubbing.states, {"given model": model_of(robot, ())}, (0.05,), controlled=True)
    assert found.notes == ()
    assert np.isfinite(found.q[0]).all()


def test_a_model_that_cannot_be_simulated_leaves_the_others_as_they_are(rubbing, models):
    broken = replace(models["given model"], late=np.nan)
    found = replayed_motion(rubbing.log, rubbing.states, {**models, "broken model": broken}, (0.5, 0.1))
    assert np.isnan(found.q[2]).all()
    assert np.isfinite(found.q[0]).all()
    assert found.horizon_s == 0.5
    assert found.notes[0].startswith("The motion of the broken model cannot be simulated: ")


def test_all_models_start_again_as_often_as_the_one_that_runs_away_first_needs(rubbing, models):
    # Closed form: a joint of inertia I with a spring of -k runs away as exp(t sqrt(k / I)): here beyond any speed
    # within half a second, and not within a tenth.
    pushed = model_of(
        rubbing.robot, known_causes(rubbing.robot, (KnownEffect("parasitic_spring", "elbow", (-100.0, 0.0)),))
    )
    found = replayed_motion(rubbing.log, rubbing.states, {**models, "pushed model": pushed}, (0.5, 0.1))
    assert (found.horizon_s, len(found.notes)) == (0.1, 1)
    assert "every 0.1 s: over 0.5 s it leaves all bounds" in found.notes[0]
    again = replayed_motion(rubbing.log, rubbing.states, models, (0.1,))
    np.testing.assert_array_equal(found.q[0], again.q[0])


def _with_controllers(robot, gains):
    return replace(robot, actuators=tuple(replace(a, controller=Controller(**gains)) for a in robot.actuators))
