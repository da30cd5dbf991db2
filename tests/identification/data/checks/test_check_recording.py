"""Checks of a recording, in one line each."""

import re
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from identification.data.checks.against_model import check_flipped, model_torque
from identification.data.checks.check_recording import checked
from identification.data.checks.one_line import Separated, is_one_sine, lines_of, one_line_words, separated
from identification.data.checks.positions import jumps, quantum
from identification.data.checks.readings.reading import Reading
from identification.data.checks.smoothed_copy import smoothed
from identification.data.checks.torques.torque_lag import lags_and_low_passes
from identification.data.reading import read_recording
from identification.data.recording import Recording
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion


def only(warnings: tuple[str, ...]) -> str:
    """The one sentence that is there."""
    assert len(warnings) == 1, warnings
    return warnings[0]


def with_load(arm: Robot) -> Robot:
    """The arm with a kilogram on its last link."""
    loaded = replace(arm)
    loaded.model.appendBodyToJoint(3, pin.Inertia.FromSphere(1.0, 0.05), pin.SE3(np.eye(3), np.array([0.3, 0.1, 0.0])))
    return loaded


@pytest.mark.parametrize(
    "made",
    [
        *({"seed": k} for k in range(6)),
        *({"rate": hz} for hz in (50.0, 125.0, 1000.0)),
        {"noise": 0.0},
        {"friction": 4.0},
    ],
    ids=str,
)
def test_a_clean_recording_of_any_rate_noise_or_friction_gives_no_warning(clean, arm, made):
    assert checked(clean(**made), arm).warnings == ()


def test_a_recording_rounded_to_four_digits_gives_no_warning(arm, changed, recording):
    rounded = changed(recording, q=recording.q.round(4), tau=recording.tau.round(2), v=recording.v.round(3))
    assert checked(rounded, arm).warnings == ()


def test_a_heavy_payload_is_no_fault_of_the_recording(clean, arm):
    assert checked(clean(robot=with_load(arm)), arm).warnings == ()


def test_a_clean_recording_without_robot_gives_no_warning(clean):
    assert checked(clean(), None).warnings == ()


def test_the_real_ur10_recording_gives_no_warning(data_folder):
    robot = load_robot("example:ur10")
    found = read_recording(data_folder / "ur10_unisa" / "ur10_exciting_trajectory.db3", robot)
    assert found.warnings == ()


def test_jitter_is_reported_with_its_share(arm, changed, rng, recording):
    t = recording.t + rng.uniform(-0.0004, 0.0004, len(recording.t))
    assert "sampling is irregular" in checked(changed(recording, t=t), arm).warnings[0]


def test_a_gap_is_reported_with_its_place_and_length(arm, recording):
    kept = (recording.t < 5.0) | (recording.t > 5.1)
    cut = replace(
        recording, t=recording.t[kept], q=recording.q[kept], tau=recording.tau[kept], v=recording.v[kept]
    )  # fmt: skip
    sentence = next(w for w in checked(cut, arm).warnings if "gap" in w)
    assert "1 gap in time" in sentence
    assert "0.104 s at t = 4.998 s" in sentence


def test_an_excluded_gap_is_not_reported(arm, recording):
    kept = (recording.t < 5.0) | (recording.t > 5.1)
    cut = Recording(
        "cut.csv", arm.joint_names, recording.t[kept], recording.q[kept], recording.tau[kept],
        excluded=((4.9, 5.2),),
    )  # fmt: skip
    assert not any("gap" in w for w in checked(cut, arm).warnings)


def test_positions_read_at_half_the_rate_are_frozen(clean, arm, changed):
    recording = clean(rate=200.0)
    q = recording.q.copy()
    q[1::2, 1] = q[:-1:2, 1]
    sentence = next(w for w in checked(changed(recording, q=q), arm).warnings if "repeats" in w)
    assert "q of tilt" in sentence


@pytest.mark.parametrize("rows", [3, 5, 10, 20])
def test_positions_that_are_held_for_any_number_of_rows_are_frozen(clean, arm, changed, rows):
    recording = clean(rate=200.0)
    held = recording.q[np.arange(len(recording.q)) // rows * rows]
    said = [w for w in checked(replace(changed(recording, q=held), v=None), arm).warnings if "repeats" in w]
    assert [re.search(r"longest time for (\d+) samples", w)[1] for w in said] == [str(rows)] * 3
    assert all(float(re.search(r"\((\d+) % of those in motion", w)[1]) > 40 for w in said)


@pytest.mark.parametrize("speed", [0.02, 0.1, 0.5])
def test_a_coarse_encoder_of_uneven_steps_is_not_frozen(speed, rng):
    # Known truth: the position is read in every row, to marks that are not evenly apart.
    t = np.arange(10000) / 500
    marks = np.cumsum(0.01 * rng.uniform(0.7, 1.3, 400)) - 2
    q = speed * t[-1] / 4 * np.sin(2 * np.pi * t / t[-1] * 2)
    read = marks[np.clip(np.searchsorted(marks, q), 0, 399)][:, None]
    recording = Recording("a.csv", ("j",), t, read, np.cos(t)[:, None])
    assert not [w for w in checked(recording, None).warnings if "repeats" in w]


def test_a_slow_joint_that_sticks_now_and_then_is_not_frozen():
    # Known truth: it moves by 1.5 steps of its encoder a row, and sticks for ten rows once a second.
    t = np.arange(10000) / 500
    q = 0.3 * np.sin(2 * np.pi * 0.04 * t)
    for start in range(100, 9000, 500):
        q[start : start + 10] = q[start]
    recording = Recording("a.csv", ("j",), t, (np.round(q / 1e-4) * 1e-4)[:, None], np.cos(t)[:, None])
    assert not [w for w in checked(recording, None).warnings if "repeats" in w]


def test_a_stalled_encoder_is_reported_with_its_place(arm, changed, recording):
    q = recording.q.copy()
    k = 2000 + int(np.argmax(np.abs(recording.v[2000:3000, 0])))
    q[k : k + 9, 0] = q[k, 0]
    sentence = next(w for w in checked(changed(recording, q=q), arm).warnings if "repeats" in w)
    assert "the longest time for 9 samples" in sentence
    assert f"t = {recording.t[k]:.6g} s" in sentence


def test_a_joint_that_sticks_is_not_frozen(arm, changed, recording):
    q = recording.q.copy()
    q[:, 0] = np.clip(q[:, 0], -0.2, 0.2)
    assert not any(
        "repeats" in w for w in checked(changed(recording, q=q, v=np.gradient(q, axis=0) * 500), arm).warnings
    )


def test_degrees_are_reported_without_a_robot(changed, recording):
    assert any("look like degrees" in w for w in checked(changed(recording, q=np.rad2deg(recording.q)), None).warnings)


def test_velocity_in_degrees_is_reported(arm, changed, recording):
    sentence = only(
        checked(changed(recording, v=np.rad2deg(recording.v) * [1, 0, 0] + recording.v * [0, 1, 1]), arm).warnings
    )
    assert "measured velocity of turn is 57.3 times the derivative of its position: the units differ" in sentence


def test_velocity_with_the_wrong_sign_is_reported(arm, changed, recording):
    sentence = only(checked(changed(recording, v=recording.v * [1, -1, 1]), arm).warnings)
    assert "measured velocity of tilt has the opposite sign" in sentence


def test_velocity_of_another_joint_is_reported(arm, changed, recording):
    warnings = checked(changed(recording, v=recording.v[:, [1, 0, 2]]), arm).warnings
    assert ["turn" in w or "tilt" in w for w in warnings] == [True, True]
    assert all("does not follow the derivative" in w for w in warnings)


def test_swapped_columns_of_two_joints_are_reported(arm, changed, recording):
    order = [1, 0, 2]
    swapped = changed(recording, q=recording.q[:, order], v=recording.v[:, order], tau=recording.tau[:, order])
    assert "turn and tilt look swapped" in only(checked(swapped, arm).warnings)


@pytest.mark.parametrize("samples", [-2.0, -0.5, 0.5, 1.0, 3.5])
def test_the_lag_of_the_torque_is_estimated_to_a_tenth_of_a_sample(clean, arm, samples):
    recording = clean(late=samples / 500)
    lags = [lag for lag, _ in lags_and_low_passes(arm, recording, smoothed(recording)) if lag]
    assert [lag.samples for lag in lags] == pytest.approx([samples] * 3, abs=0.1)


def test_a_torque_half_a_sample_early_is_reported_and_explained_by_the_hold(clean, arm):
    warnings = checked(clean(late=-0.5 / 500), arm).warnings
    assert len(warnings) >= 2
    said = r"torque of turn is early against its motion by 1\.0\d ms \(0\.5\d samples\): torque_hold: zoh"
    assert re.search(said, warnings[0])


def test_a_held_torque_that_the_robot_states_is_not_reported(clean, arm):
    assert checked(clean(late=-0.5 / 500), replace(arm, torque_hold="zoh")).warnings == ()


def test_a_late_torque_is_reported_in_milliseconds(clean, arm, changed):
    recording, late = clean(), clean(late=0.004)
    tau = recording.tau.copy()
    tau[:, 0] = late.tau[:, 0]
    said = r"torque of turn is late against its motion by 3\.9\d ms \(2 samples\)"
    assert re.search(said, checked(changed(recording, tau=tau), arm).warnings[0])


def test_a_log_in_which_all_torques_are_late_is_refused_with_the_entry(clean, arm):
    # Known truth: 4 ms, a low pass at 1 / (2 pi 0.004 s) = 40 Hz. No drive makes its torque late.
    (fault,) = checked(clean(late=0.004), arm).wrong
    assert re.search(r"the torques are late against their motion by (3\.9\d*|4|4\.0\d*) ms", fault.what)
    # Two rows of 2 ms. In a motion that is slow beside 40 Hz, a low pass there is such a delay, too.
    assert fault.mend.startswith("write tau: {late: 0.004} into a column map")
    assert re.search(r"or, if they went through a low pass of first order, write tau: \{low_pass: (39|40)", fault.mend)


def test_torques_that_are_early_or_late_by_different_times_are_not_refused(clean, arm, changed):
    # A slow drive has a torque that is early, and the drives of a bus are late alike.
    assert not checked(clean(late=-0.004), arm).wrong
    recording = clean()
    tau = np.column_stack([clean(late=late).tau[:, j] for j, late in enumerate((0.002, 0.004, 0.008))])
    assert not checked(changed(recording, tau=tau), arm).wrong


def test_a_wrong_inertia_does_not_pass_for_a_lag(clean, arm):
    recording = clean(robot=with_load(arm))
    found = lags_and_low_passes(arm, recording, smoothed(recording))
    assert [lag.samples for lag, _ in found if lag] == pytest.approx([0] * 3, abs=0.1)


def test_a_tail_at_rest_is_reported_with_its_start(arm, changed, recording):
    q, v, tau = recording.q.copy(), recording.v.copy(), recording.tau.copy()
    q[8000:], v[8000:], tau[8000:] = q[8000], 0.0, tau[8000]
    warnings = checked(changed(recording, q=q, v=v, tau=tau), arm).warnings
    assert any("no joint moves from t = 16 s to the end" in w and "--exclude 16:" in w for w in warnings)


def test_an_excluded_tail_is_not_reported(arm, changed, recording):
    q = recording.q.copy()
    q[8000:] = q[8000]
    cut = replace(changed(recording, q=q), v=None, excluded=((15.9, 20.0),))
    assert not any("no joint moves" in w for w in checked(cut, arm).warnings)


def test_a_joint_that_never_moves_is_named(arm, changed, rng, recording):
    q, v = recording.q.copy(), recording.v.copy()
    q[:, 0], v[:, 0] = 0.3 + 1e-5 * rng.standard_normal(len(q)), 0.0
    assert any("turn never moves" in w for w in checked(changed(recording, q=q, v=v), arm).warnings)


@pytest.mark.parametrize(("parts", "times"), [(2, 4.0), (10, 4.0), (50, 1.0)])
def test_a_motor_encoder_that_wraps_behind_a_gear_is_reported(arm, changed, parts, times, recording):
    q, wrap = recording.q.copy(), 2 * np.pi / parts
    turned = 1.0 + times * q[:, 1]
    q[:, 1] = np.mod(turned, wrap)
    wraps = np.count_nonzero(np.diff(turned // wrap))
    said = [
        w for w in checked(replace(changed(recording, q=q), v=None), arm).warnings if "from one sample to the next" in w
    ]
    assert f"q of tilt jumps by up to {wrap:.3g}"[:-1] in only(tuple(said))
    # Where it turns back at once, a jump is not counted.
    assert 0.9 * wraps <= int(re.search(r"next, (\d+) times", said[0]).group(1)) <= wraps


def test_steps_of_a_coarse_encoder_and_ways_across_a_gap_are_no_jumps(rng):
    t = np.arange(5000) / 500
    q = np.sin(2 * np.pi * 0.3 * t)
    coarse = np.round(q, 1) + 1e-6 * rng.standard_normal(len(q))
    here = (t < 3.0) | (t > 3.4)
    assert len(jumps(t, coarse, 0.02, 1e-6)) == 0
    assert len(jumps(t[here], q[here], 0.02, 0.0)) == 0


def test_a_coarse_encoder_is_reported_with_its_step(arm, changed, recording):
    q = recording.q.copy()
    q[:, 0] = np.round(q[:, 0] / 0.05) * 0.05
    assert any("encoder of turn has the coarse step 0.05" in w for w in checked(changed(recording, q=q), arm).warnings)


def test_a_coarse_encoder_that_the_robot_states_is_not_reported(arm, changed, recording):
    q = recording.q.copy()
    q[:, 0] = np.round(q[:, 0] / 0.05) * 0.05
    actuators = (replace(arm.actuators[0], encoder_counts=2 * np.pi / 0.05), *arm.actuators[1:])
    stated = replace(arm, actuators=actuators)
    assert not any("coarse" in w for w in checked(changed(recording, q=q), stated).warnings)


@pytest.mark.parametrize("step", [1e-5, 7.67e-4, 0.0879 * np.pi / 180])
def test_the_encoder_step_is_read_off_the_positions(step):
    q = np.round(np.sin(np.arange(5000) / 300) / step) * step
    assert quantum(q) == pytest.approx(step, rel=1e-6)


def test_a_continuous_position_has_no_encoder_step(rng):
    assert quantum(np.sin(np.arange(5000) / 300) + 1e-4 * rng.standard_normal(5000)) == 0.0


@pytest.mark.parametrize("noise", [0.0, 1e-5])
def test_constant_speed_is_no_encoder_step(rng, noise):
    # Closed form: a line has equal differences from sample to sample, wherever it is read.
    assert quantum(1.2e-3 * np.arange(3000) + noise * rng.standard_normal(3000)) == 0.0


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_friction_of_a_joint_that_moves_one_way_does_not_tell_the_sign_of_its_torque(clean, arm, rng, direction):
    # Closed form: at constant speed friction is one column with an offset, which may have either sign.
    t = np.arange(300) / 100
    zeros = np.zeros((300, 3))
    v = np.tile([0.3 * direction, 0.1 * direction, -0.3 * direction], (300, 1))
    tau = np.array([-0.5, 0.5, -0.5]) + 0.01 * rng.standard_normal((300, 3))
    data = Reading(Motion(t, t[:, None] * v, v, zeros), np.sign(v), tau, zeros)
    assert check_flipped(clean(), arm, data, zeros) == ()


@pytest.mark.parametrize(("lifted", "sign", "warned"), [(3.5, 1.0, False), (0.0, -1.0, True)])
def test_a_counterbalance_that_is_stronger_than_gravity_does_not_flip_a_torque(clean, arm, rng, lifted, sign, warned):
    # Closed form: 3.5 times the weight of tilt is lifted, so that it counts -2.5 times, and inertia and friction once.
    motion = waves(0.3, 1.0, 2.0, frequencies=[1.3, 1.1, 1.7]).at(np.arange(0, 4000, 13))
    still = replace(motion, v=0 * motion.v, a=0 * motion.v)
    model, weight = model_torque(arm, motion), model_torque(arm, still)
    tau = sign * (model - lifted * weight + 0.2 * np.sign(motion.v)) + 0.01 * rng.standard_normal(model.shape)
    warnings = check_flipped(clean(), arm, Reading(motion, np.sign(motion.v), tau, 0 * tau), model)
    assert any("the torque of tilt has the opposite sign" in one for one in warnings) == warned


def test_a_torque_that_may_have_lost_its_sign_is_warned_of(arm, changed, recording):
    # Something else that is not modelled keeps the magnitude from being certain.
    tau = recording.tau.copy()
    tau[:, 1] = np.abs(tau[:, 1]) + tau[:, 1].std() * (1 + np.sin(9 * recording.t))
    assert any("torque of tilt is never negative" in w for w in checked(changed(recording, tau=tau), arm).warnings)


def waves(*phases, frequencies=None):
    t = np.arange(0.0, 20.0, 0.005)
    w = np.ones(len(phases)) if frequencies is None else np.array(frequencies)
    angle = w * t[:, None] + np.array(phases)
    return Motion(t, np.sin(angle), w * np.cos(angle), -(w**2) * np.sin(angle))


def test_joints_that_follow_one_profile_are_on_one_line():
    # Half the profile, backwards and 5 ms late, is the same line; a joint that stands is on none.
    t = np.arange(0.0, 20.0, 0.005)
    v = np.column_stack([np.cos(t), -0.5 * np.cos(t - 0.005), np.cos(3 * t), 0.0 * t])
    assert lines_of(v) == ((0, 1),)


@pytest.mark.parametrize("shown", [4, 6])
def test_a_line_that_shows_all_base_parameters_is_warned_of_for_another_reason(shown):
    # By hand: six of six that show are no reason to doubt a link.
    words = one_line_words(["hip", "knee"], Separated(shown, 6, 4.0))
    assert ("of the 6 base parameters of the links 4 show (condition 4)" in words) == (shown == 4)
    assert ("other causes together may look like" in words) == (shown == 6)


def test_a_motion_along_one_line_shows_fewer_base_parameters(planar2):
    free = separated(planar2, waves(0.0, 1.0, frequencies=(1.0, 2.3)))
    line = separated(planar2, waves(0.0, 0.0))
    assert line.all == free.all == 6
    assert line.shown < free.shown
    assert line.condition > free.condition


def test_a_check_names_the_joints_of_a_line(lab, planar2):
    recording = lab.recording(planar2, waves(0.0, 0.0, frequencies=(2.0, 2.0)), np.zeros((4000, 2)))
    words = [one for one in checked(recording, planar2).warnings if "along one line" in one]
    assert len(words) == 1
    assert words[0].startswith("shoulder and elbow move along one line")


@pytest.mark.parametrize("joints", [1, 3])
def test_one_joint_alone_is_on_no_line(joints):
    v = np.cos(np.arange(100.0))[:, None] * np.ones((1, joints))
    assert lines_of(v) == (((0, 1, 2),) if joints == 3 else ())


@pytest.mark.parametrize(("hertz", "alone"), [((0.7,), True), ((0.7, 1.1), False), ((0.1,), False)])
def test_motion_of_one_frequency_is_one_sine(rng, hertz, alone):
    t = np.arange(4000) / 200.0
    q = sum(np.sin(2 * np.pi * f * t) for f in hertz) + 1e-3 * rng.standard_normal(len(t))
    assert is_one_sine(q) is alone
