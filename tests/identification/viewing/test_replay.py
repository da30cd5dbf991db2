"""A recording replayed: motion, poses, solids."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from identification.data.recording import Fault
from identification.diagnosis.columns.terms import KnownEffect
from identification.rollout.simulated_models import known_causes, model_of
from identification.viewing.corrections import Correction
from identification.viewing.replay import MOST_FRAMES, frame_rows, link_poses, replay_of, replayed_motion, stretches
from identification.viewing.robot_solids import boxes, robot_solids
from identification.viewing.status import legend, now_table, summary
from phantom_dyn.effects.author import EffectWords, LawEffect, Parameter, row_of, torque_on_joint
from phantom_dyn.effects.user.user_effects import with_user_effects
from phantom_dyn.errors import LogError
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Controller
from phantom_dyn.shapes.meshes import Mesh, joined
from places import ROBOTS


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


def test_poses_are_those_of_pinocchio(arm, rng):
    q = rng.uniform(-1, 1, (5, arm.nv))
    poses, data = link_poses(arm, q), arm.model.createData()
    for row, pose in zip(q, poses, strict=True):
        pin.forwardKinematics(arm.model, data, row)
        for place, found in zip(data.oMi, pose, strict=True):
            np.testing.assert_allclose(found[:3], place.translation, atol=1e-12)
            turned = Rotation.from_quat(found[3:], scalar_first=True).as_matrix()
            np.testing.assert_allclose(turned, place.rotation, atol=1e-12)


def test_the_root_stands_still(arm):
    np.testing.assert_array_equal(link_poses(arm, np.ones((1, 3)))[0, 0], [0, 0, 0, 1, 0, 0, 0])


def test_the_loop_of_a_closed_chain_is_closed_at_every_frame(rng):
    # Published geometry (PHANToM 1.5, seed of its table): joint angles are absolute, so `elbow` turns against theta2.
    robot = load_robot("phantom_1_5")
    q = rng.uniform(-0.3, 0.3, (3, 3))
    data, poses = robot.model.createData(), link_poses(robot, q)
    for row, pose in zip(q, poses, strict=True):
        pin.forwardKinematics(robot.model, data, robot.configuration(row[None])[0])
        np.testing.assert_allclose(pose[:, :3], [place.translation for place in data.oMi], atol=1e-12)


def test_a_position_that_is_not_known_has_no_pose(arm):
    q = np.zeros((3, 3))
    q[1, 2] = np.nan
    assert np.isnan(link_poses(arm, q)[1]).all()
    assert np.isfinite(link_poses(arm, q)[[0, 2]]).all()


@pytest.fixture(scope="module")
def sliding(replay):
    """The same replay with a robot whose third joint slides by 0.4 m."""
    robot = load_robot(ROBOTS / "arm3.urdf")
    q = np.zeros((50, 3))
    q[:, 2] = np.linspace(-0.1, 0.3, 50)
    copy = replace(replay.copies[0], q=q, poses=link_poses(robot, q))
    return replace(replay, robot=robot, copies=(copy,))


def test_the_box_of_a_posture_is_that_of_its_turned_corners(rng):
    points, wxyz, place = rng.standard_normal((9, 3)), rng.standard_normal(4), rng.standard_normal(3)
    wxyz /= np.linalg.norm(wxyz)
    (found,) = boxes(np.array([[[*place, *wxyz]]]), (Mesh(points, np.zeros((0, 3), dtype=int)),))
    turned = Rotation.from_quat(wxyz, scalar_first=True).apply(points) + place
    every = np.vstack([turned, place])
    np.testing.assert_allclose(found, [every.min(axis=0), every.max(axis=0)], atol=1e-12)


def test_copies_do_not_reach_into_each_other(replay):
    solids = robot_solids(replay)
    offsets = solids.offsets(3)
    axis = int(np.argmax(offsets[1]))
    assert solids.size[axis] < offsets[1, axis]
    np.testing.assert_allclose(offsets[2], 2 * offsets[1])


def test_a_linear_joint_runs_on_a_rail_as_long_as_its_way(sliding):
    (rail,) = [mesh for mesh in robot_solids(sliding).rails if len(mesh.faces)]
    length = np.linalg.norm(rail.points.max(axis=0) - rail.points.min(axis=0))
    assert 0.4 < length < 0.42


def test_there_is_a_solid_for_every_joint(replay):
    solids = robot_solids(replay)
    assert [len(mesh.faces) > 0 for mesh in solids.drums] == [False, True, True]


def test_the_floor_is_below_what_stands_still(replay):
    solids = robot_solids(replay)
    assert replace(solids, links=(joined([]), *solids.links[1:])).floor == 0.0
    base = Mesh(np.array([[0, 0, -0.2], [1, 0, 0.1], [0, 1, 0.0]]), np.array([[0, 1, 2]]))
    assert replace(solids, links=(base, *solids.links[1:])).floor == -0.2
