"""What a replay holds. Oracles: known truth, Pinocchio's forward kinematics, and counts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from identification.data.recording import Fault
from identification.diagnosis.columns.terms import KnownEffect
from identification.viewing.corrections import Correction
from identification.viewing.replay import MOST_FRAMES, frame_rows, replay_of
from identification.viewing.status import legend, now_table, summary
from phantom_dyn.effects.author import EffectWords, LawEffect, Parameter, row_of, torque_on_joint
from phantom_dyn.effects.user.user_effects import with_user_effects
from phantom_dyn.errors import LogError


def test_the_measured_copy_is_where_the_readings_say(rubbing, replay):
    model, k = rubbing.robot.model, 37
    data = model.createData()
    row = int(np.searchsorted(rubbing.recording.t, replay.t[k]))
    pin.forwardKinematics(model, data, rubbing.recording.q[row])
    found = replay.copies[0].poses[k, :, :3]
    np.testing.assert_allclose(found, [place.translation for place in data.oMi], atol=1e-9)


def test_the_joint_that_lacks_friction_is_the_strongest(rubbing, replay):
    assert rubbing.robot.joint_names[replay.strongest_joint()] == "elbow"


def test_the_corrected_model_is_paler_than_the_given_one(replay):
    _, given, corrected = (copy.strength[:, 1].mean() for copy in replay.copies)
    assert corrected < 0.1 * given
    assert given > 0.3


def test_the_corrected_copy_is_nearer_to_the_measured_one(replay):
    measured, given, corrected = (copy.poses[..., :3] for copy in replay.copies)
    assert np.abs(corrected - measured).max() < 0.1 * np.abs(given - measured).max()


def test_the_friction_may_be_part_of_the_given_model(rubbing, lacking):
    found = replay_of(rubbing.robot, rubbing.recording, known=(lacking,))
    assert [copy.name for copy in found.copies] == ["measured", "given model"]
    assert np.abs(found.copies[1].q - found.copies[0].q).max() < 0.005


def test_frames_are_at_most_fifty_a_second():
    assert np.diff(frame_rows(np.arange(2000) / 1000.0)).tolist() == [20] * 99


def test_a_slow_recording_has_all_its_samples():
    assert len(frame_rows(np.arange(300) / 20.0)) == 300


def test_a_long_recording_has_a_limited_number_of_frames():
    assert MOST_FRAMES / 2 < len(frame_rows(np.arange(1_000_000) / 100.0)) <= MOST_FRAMES


@pytest.mark.parametrize(("time", "frame"), [(-1.0, 0), (0.0, 0), (0.011, 1), (0.029, 1), (99.0, 499)])
def test_the_frame_of_a_time_is_the_nearest(replay, time, frame):
    assert replay.frame(time) == frame


@pytest.mark.parametrize(
    ("asked", "stated", "horizon"), [(None, None, 0.5), (None, 0.25, 0.25), (0.1, 0.25, 0.1)], ids=str
)
def test_the_horizon_is_the_asked_one_else_that_of_the_diagnosis(rubbing, asked, stated, horizon):
    found = replay_of(rubbing.robot, rubbing.recording, correction=Correction(horizon_s=stated), horizon_s=asked)
    assert found.horizon_s == horizon


def test_a_recording_that_is_certainly_wrong_is_refused(rubbing):
    fault = Fault("the positions of elbow are in degrees", "why", "map them")
    with pytest.raises(LogError, match="positions of elbow are in degrees"):
        replay_of(rubbing.robot, replace(rubbing.recording, wrong=(fault,)))


def test_the_page_says_what_the_corrected_model_has(replay):
    assert "The corrected model has Coulomb friction on joint elbow." in summary(replay)


def test_an_effect_on_several_joints_is_named_once(rubbing, lacking):
    found = (lacking, replace(lacking, joint="shoulder"))
    both = replay_of(rubbing.robot, rubbing.recording, correction=Correction(found))
    assert both.corrections == ("Coulomb friction on joints elbow and shoulder",)


def test_without_a_diagnosis_the_page_says_how_to_give_one(replay):
    assert "--diagnosis FILE" in summary(replace(replay, copies=replay.copies[:2], corrections=()))


def test_the_legend_names_the_share_of_the_full_colour(replay):
    assert "orange where it is 42\xa0% of the joint's usual torque" in legend(replace(replay, full=0.42))


def test_the_table_of_a_moment_holds_the_residuals_of_both_models(replay):
    row = int(np.argmin(np.abs(replay.curves.t - 5.0)))
    cells = now_table(replay, 5.0, replay.frame(5.0)).splitlines()[-1].split(" | ")
    wanted = [replay.curves.residual(k)[row, 1] for k in (0, 1)]
    np.testing.assert_allclose([float(cell.strip(" |")) for cell in cells[-2:]], wanted, rtol=0.01)


@pytest.mark.whole
def test_a_correction_by_an_effect_of_the_users_own_is_shown_in_its_words(rubbing, replay):
    # Known truth: the Coulomb friction that the model lacks, smoothed over a speed that the joint soon has.
    class OilDrag(LawEffect):
        name = "oil_drag"
        words = EffectWords("drag in oil", "drag in oil", "Look for oil.")

        def parameters(self, robot, joint):
            return (Parameter("torque", "N m", 0.0),)

        def torque(self, robot, operation, joint, theta):
            v = operation.v[:, row_of(robot, joint)]
            return torque_on_joint(robot, joint, -theta[0] * np.tanh(v / 0.02))

    carrying = with_user_effects(rubbing.robot, OilDrag)
    shown = replay_of(carrying, rubbing.recording, correction=Correction((KnownEffect("oil_drag", "elbow", (0.3,)),)))
    assert shown.corrections == ("drag in oil on joint elbow",)
    measured, given, corrected = (copy.poses[..., :3] for copy in shown.copies)
    assert np.abs(corrected - measured).max() < 0.2 * np.abs(given - measured).max()
