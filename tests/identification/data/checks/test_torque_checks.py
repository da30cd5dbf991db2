"""Checks of torques: filtered, flat, late, without friction, weight and friction."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, lfilter, lfilter_zi, sosfilt

import phantom_dyn as dyn
from identification.data.checks.check_recording import checked
from identification.data.checks.smoothed_copy import smoothed
from identification.data.checks.times_and_torques import check_flat
from identification.data.checks.torques.filtered_torques import check_filtered, filtered_joints, roll_off
from identification.data.checks.torques.subtracted_friction import check_subtracted_friction, friction_shares
from identification.data.checks.torques.torque_lag import clear_samples, friction_columns, lags_and_low_passes
from identification.data.checks.torques.weight_and_friction import computed_from_weight, lifted_less_lowered
from identification.data.recording import Recording
from phantom_dyn.dynamics.dynamics import active_friction, inverse_dynamics
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion
from places import ROBOTS


def low_passed(x: np.ndarray, edge: float = 0.1) -> np.ndarray:
    """Second order; the edge as a share of half the rate."""
    return sosfilt(butter(2, edge, output="sos"), x, axis=0)


def said(recording) -> tuple[str, ...]:
    return check_filtered(recording, filtered_joints(recording))


def test_white_noise_has_no_roll_off(rng):
    assert roll_off(rng.standard_normal((20000, 1))) == pytest.approx(0.0, abs=0.5)


def test_a_mean_of_two_samples_rolls_off_as_its_cosine(rng):
    # Closed form: the power of a mean of two is cos(pi f)^2; the medians lie near the middles of the bands.
    x = rng.standard_normal(40001)
    wanted = 20 * np.log10(np.cos(np.pi * 0.415) / np.cos(np.pi * 0.185))
    assert roll_off((x[1:, None] + x[:-1, None]) / 2) == pytest.approx(wanted, abs=0.7)


def test_a_slow_motion_does_not_leak_into_the_bands(rng):
    x = 100 * np.sin(np.arange(20000) / 300) + 1e-3 * rng.standard_normal(20000)
    assert roll_off(x[:, None]) == pytest.approx(0.0, abs=0.7)


def test_filtered_torques_are_reported_with_their_joints(arm, changed, recording):
    tau = recording.tau.copy()
    tau[:, :2] = low_passed(tau[:, :2])
    (sentence,) = said(changed(recording, tau=tau))
    assert "the torques of turn, tilt went through a low-pass that the positions did not" in sentence
    assert "the noise above the band cannot be used" in sentence


def test_torques_and_positions_filtered_alike_are_not_reported(arm, changed, rng, recording):
    q = recording.q + 1e-5 * rng.standard_normal(recording.q.shape)
    assert said(changed(recording, q=low_passed(q), tau=low_passed(recording.tau))) == ()


@pytest.mark.parametrize(("value", "said"), [(0.0, "is 0 in every row from 4"), (2.5, "is 2.5 in every row from 4")])
def test_a_torque_that_stays_the_same_in_most_rows_is_named_with_the_stretch_to_leave_out(clean, arm, value, said):
    recording = clean(rate=200.0)
    tau = recording.tau.copy()
    tau[recording.t >= 4.0, 1] = value
    (sentence,) = check_flat(replace(recording, tau=tau))
    assert f"tau.{arm.joint_names[1]} {said} to 19.995 s (80 % of the rows)" in sentence
    assert sentence.endswith("--exclude 4:19.995.")
    assert sentence in checked(replace(recording, tau=tau), arm).warnings


def test_a_torque_that_stays_the_same_at_rest_or_for_a_short_time_is_no_fault(clean):
    recording = clean(rate=200.0)
    tau, q = recording.tau.copy(), recording.q.copy()
    tau[recording.t >= 4.0, 1] = 2.5
    q[recording.t >= 4.0, 1] = 0.1
    assert check_flat(replace(recording, tau=tau, q=q)) == ()
    tau = recording.tau.copy()
    tau[recording.t >= 12.0, 1] = 2.5
    assert check_flat(replace(recording, tau=tau)) == ()


@pytest.mark.whole
def test_a_torque_that_is_early_is_no_warning_beside_the_delay_that_is_found(rng):
    robot = load_robot(ROBOTS / "pendulum.urdf")
    t, w, size = np.arange(4000) / 200.0, 2 * np.pi * np.array([0.31, 0.83, 1.7]), np.array([0.5, 0.3, 0.15])

    def motion(t: np.ndarray) -> Motion:
        phase = np.outer(t, w)
        parts = np.sin(phase), w * np.cos(phase), -(w**2) * np.sin(phase)
        return Motion(t, *((part * size).sum(axis=1)[:, None] for part in parts))

    # A drive that acts d late is asked for a torque d before the motion that it makes.
    tau = inverse_dynamics(robot, motion(t + 0.009)) + 0.02 * rng.standard_normal((len(t), 1))
    recording = Recording("bench.csv", robot.joint_names, t, motion(t).q + 1e-5 * rng.standard_normal(tau.shape), tau)
    warnings = checked(recording, robot).warnings
    assert any("early against its motion" in text for text in warnings)
    diagnosis = dyn.diagnose(robot, replace(recording, warnings=warnings))
    (found,) = diagnosis.findings
    assert (found.effect, found.parameters["delay"].value) == ("input_delay", pytest.approx(0.009, abs=1e-3))
    assert not any("against its motion" in text for text in diagnosis.warnings)


def lags_of(robot: Robot, recording) -> list[float]:
    return [lag.samples for lag, _ in lags_and_low_passes(robot, recording, smoothed(recording)) if lag]


@pytest.mark.parametrize("late", [0.0, 0.003])
def test_friction_that_turns_about_later_than_the_motion_is_no_lag(clean, arm, changed, late):
    # Known truth: the torque is late by 0 or 1.5 samples; as where a joint sticks, its friction turns 15 ms later.
    recording = clean(late=late, seconds=40.0)
    sign = np.roll(np.sign(recording.v), round(500 * late), axis=0)
    rubs = 3.0 * arm.coulomb_friction * (np.roll(sign, round(500 * 0.015), axis=0) - sign)
    stuck = changed(recording, tau=recording.tau + rubs)
    assert lags_of(arm, stuck) == pytest.approx([500 * late] * 3, abs=0.1)


@pytest.mark.nightly
def test_a_simulated_pendulum_that_sticks_has_no_lag():
    # Known truth: positions and torques of a simulation have one time, whatever the friction.
    robot = dyn.load_robot(ROBOTS / "pendulum.urdf")
    reference = dyn.excite(robot, duration=20.0)
    made = dyn.simulate(robot, reference, effects=[("coulomb_friction", "pin", {"torque": 1.5})])
    recording = made.recording(position_noise=1e-5, torque_noise=0.02, seed=1)
    assert lags_of(robot, recording) == pytest.approx([0.0], abs=0.1)
    assert not any("against its motion" in sentence for sentence in checked(recording, robot).warnings)


def test_samples_are_clear_where_the_filter_touches_no_reversal():
    # Closed form: of a sine of 0.5 Hz at 1 kHz, 16 ms below a twentieth of its top speed, then 50 ms and the filter.
    t = np.arange(4000) / 1000.0
    clear = clear_samples(np.cos(np.pi * t + 1e-4), np.ones(len(t), dtype=bool), 100, 1e-3)
    apart = np.abs((t % 1.0) - 0.5)
    edge = np.arcsin(0.05) / np.pi + 0.15
    np.testing.assert_array_equal(clear[apart > edge + 0.002], True)
    np.testing.assert_array_equal(clear[apart < edge - 0.002], False)


def test_samples_beside_what_does_not_count_are_not_clear():
    inside = np.ones(1000, dtype=bool)
    inside[500] = False
    np.testing.assert_array_equal(np.flatnonzero(~clear_samples(np.ones(1000), inside, 10, 1e-3)), np.arange(490, 511))


def test_friction_may_differ_between_directions(rng):
    # Closed form: Coulomb and viscous friction with other coefficients in either direction.
    v = rng.uniform(-2.0, 2.0, 500)
    law = np.where(v > 0, 1.0 + 0.5 * v, -3.0 + 0.1 * v)
    columns = friction_columns(v)
    left = law - columns @ np.linalg.lstsq(columns, law, rcond=None)[0]
    assert np.abs(left).max() < 1e-9


@pytest.mark.parametrize("scale", [1e-310, 1e-200, 1e200])
def test_columns_of_friction_are_those_of_any_unit_of_speed(rng, scale):
    v = rng.uniform(-2.0, 2.0, 500)
    np.testing.assert_allclose(friction_columns(scale * v), friction_columns(v), atol=1e-9)


def test_positions_of_the_smallest_floats_show_no_lag(arm, recording):
    assert lags_of(arm, replace(recording, q=1e-309 * recording.q)) == []


def test_a_joint_that_turns_about_all_the_time_shows_no_lag(arm, recording):
    # Twelve times a second: every 42 ms, and a joint creeps for 50 ms before and behind each.
    q = recording.q.copy()
    q[:, 2] = 0.02 * np.sin(2 * np.pi * 12.0 * recording.t)
    copy = replace(smoothed(recording), cutoff_hz=40.0)
    assert "slide" not in [lag.joint for lag, _ in lags_and_low_passes(arm, replace(recording, q=q), copy) if lag]


def late_low_passed(recording, hertz: float) -> np.ndarray:
    """The torque behind a low pass of first order; scipy's filter, begun in its steady state."""
    b, a = butter(1, hertz, fs=500.0)
    tau, _ = lfilter(b, a, recording.tau, axis=0, zi=lfilter_zi(b, a)[:, None] * recording.tau[0])
    return tau


@pytest.mark.parametrize("hertz", [5.0, 20.0, 50.0])
def test_the_cut_off_of_a_low_pass_is_found(clean, arm, changed, hertz):
    recording = clean(seconds=40.0)
    filtered = changed(recording, tau=late_low_passed(recording, hertz))
    found = [one.hertz for _, one in lags_and_low_passes(arm, filtered, smoothed(filtered)) if one]
    assert found == pytest.approx([hertz] * 3, rel=0.05)


def test_a_low_pass_is_reported_with_the_entry_that_takes_it_back(clean, arm, changed):
    recording = clean(seconds=40.0)
    stated = [
        text
        for text in checked(changed(recording, tau=late_low_passed(recording, 5.0)), arm).warnings
        if "tilt" in text
    ]
    assert len(stated) == 1
    assert re.search(r"tilt went through a low pass of first order at 5\.?\d* Hz that the positions did not", stated[0])
    assert re.search(r"write tau\.tilt: \{low_pass: 5\.?\d*\} into a column map", stated[0])


def test_a_low_pass_far_above_the_motion_may_be_a_shift(arm, changed, recording):
    tau = recording.tau.copy()
    tau[:, 0] = late_low_passed(recording, 50.0)[:, 0]
    stated = checked(changed(recording, tau=tau), arm).warnings
    assert "late against its motion" in stated[0]
    assert "shift it, or, if it went through a low pass of first order, write tau.turn: {low_pass: 5" in stated[0]


@pytest.mark.parametrize("late", [-0.002, 0.0])
def test_a_torque_that_is_not_late_went_through_no_low_pass(clean, arm, late):
    assert not any("low pass" in text for text in checked(clean(late=late), arm).warnings)


@pytest.mark.parametrize("hertz", [8.0, 20.0])
def test_a_low_pass_of_second_order_is_not_reported_as_one_of_first(clean, arm, changed, hertz):
    # The noise above the motion tells the order: it falls off twice as steeply.
    recording = clean(seconds=40.0)
    tau = lfilter(*butter(2, hertz, fs=500.0), recording.tau - recording.tau[0], axis=0) + recording.tau[0]
    stated = checked(changed(recording, tau=tau), arm).warnings
    assert any("went through a low-pass that the positions did not" in text for text in stated)
    assert not any("first order" in text for text in stated)


EVERY, SECOND = np.ones(3), np.array([0.0, 1.0, 0.0])


@pytest.fixture
def taken(clean, arm, changed):
    """Builds a recording from which a share of each joint's modelled friction was taken."""

    def build(shares: np.ndarray):
        recording = clean(friction=1.0)
        return changed(recording, tau=recording.tau - shares * active_friction(arm, recording.v))

    return build


@pytest.mark.parametrize("share", [0.0, 0.4, 1.0])
def test_the_share_of_the_modelled_friction_that_a_torque_holds(taken, arm, share):
    held = friction_shares(arm, smoothed(taken(share * EVERY)))
    assert [one.share for one in held] == pytest.approx([1 - share] * 3, abs=0.05)


def test_the_error_of_a_share_covers_its_departure(taken, arm):
    held = friction_shares(arm, smoothed(taken(EVERY)))
    assert [abs(one.share) < 4 * one.std for one in held] == [True] * 3


def test_torques_without_friction_are_reported_with_the_entry(taken, arm):
    (sentence,) = checked(taken(EVERY), arm).warnings
    assert "the torques of turn, tilt, slide lack the friction that the model states" in sentence
    assert "write tau: {compensated: friction} into a column map and give it with --columns" in sentence


def test_one_torque_without_friction_is_reported_with_the_entry_of_its_joint(taken, arm):
    (sentence,) = checked(taken(SECOND), arm).warnings
    assert "the torque of tilt lacks the friction" in sentence
    assert "write tau.tilt: {compensated: friction} into" in sentence


def test_friction_that_is_half_of_what_the_model_states_is_not_reported(taken, arm):
    assert check_subtracted_friction(taken(0.5 * EVERY), arm, smoothed(taken(0.5 * EVERY))) == ()


def test_nothing_is_reported_where_the_column_map_says_so(taken, arm):
    assert checked(replace(taken(EVERY), friction_subtracted=arm.joint_names), arm).warnings == ()


def test_a_robot_whose_model_states_no_friction_lacks_none(taken, arm):
    bare = replace(arm, viscous_friction=np.zeros(3), coulomb_friction=np.zeros(3))
    assert friction_shares(bare, smoothed(taken(EVERY))) == ()


def test_friction_below_what_the_fit_leaves_is_not_reported(taken, arm, changed, rng):
    recording = taken(EVERY)
    friction = active_friction(arm, recording.v).std(axis=0)
    noise = rng.standard_normal(recording.tau.shape) * 6.0 * friction
    noisy = changed(recording, tau=recording.tau + noise)
    assert check_subtracted_friction(noisy, arm, smoothed(noisy)) == ()


def test_a_joint_that_its_drive_does_not_move_lacks_no_friction(taken, arm, changed):
    recording = taken(EVERY)
    idle = changed(recording, tau=recording.tau * [1.0, 0.1, 1.0])
    assert [one.joint for one in friction_shares(arm, smoothed(idle))] == ["turn", "slide"]


def test_a_joint_that_never_moves_lacks_no_friction():
    # The velocity of noise alone has no sign that friction could follow: what a fit finds along it is no friction.
    robot, rng, t = load_robot(ROBOTS / "pendulum.urdf"), np.random.default_rng(1), np.arange(2000) / 100.0
    q, tau = (rng.standard_normal((2000, 1)) * size + level for size, level in ((1e-5, 0.3), (0.01, 1.45)))
    still = Recording("still.csv", robot.joint_names, t, q, tau)
    assert friction_shares(robot, smoothed(still)) != ()
    assert check_subtracted_friction(still, robot, smoothed(still)) == ()


T = np.arange(0, 20.0, 0.01)


@pytest.fixture(scope="module")
def weighed_arm():
    return dyn.load_robot("example:double_pendulum")


def wander(count: int) -> Motion:
    """A motion of incommensurate sines of each joint."""
    w = 2 * np.pi * np.array([[0.11, 0.37], [0.17, 0.29]])[:count]
    q = (0.5 * np.sin(T[:, None, None] * w)).sum(axis=2)
    v = (0.5 * w * np.cos(T[:, None, None] * w)).sum(axis=2)
    a = (-0.5 * w**2 * np.sin(T[:, None, None] * w)).sum(axis=2)
    return Motion(T, q, v, a)


def still(motion: Motion) -> Motion:
    return Motion(motion.t, motion.q, 0 * motion.v, 0 * motion.a)


def test_a_compensation_is_a_weight_at_each_position(weighed_arm, rng):
    motion = wander(2)
    # Of another robot: twice the weight, with the noise of a current sensor.
    tau = 2.0 * inverse_dynamics(weighed_arm, still(motion))
    tau += 0.005 * tau.std(axis=0) * rng.standard_normal(tau.shape)
    assert computed_from_weight(weighed_arm, motion, tau).all()


@pytest.mark.parametrize("speed", [0.3, 1.0])
def test_a_torque_that_moves_the_robot_is_none(weighed_arm, speed):
    # Frictionless, exact, and slow: inertia alone tells it.
    m = wander(2)
    motion = Motion(m.t / speed, m.q, speed * m.v, speed**2 * m.a)
    assert not computed_from_weight(weighed_arm, motion, inverse_dynamics(weighed_arm, motion)).any()


def test_friction_makes_it_no_compensation(weighed_arm):
    motion = wander(2)
    tau = inverse_dynamics(weighed_arm, still(motion))
    friction = 0.2 * tau.std(axis=0) * np.sign(motion.v)
    assert not computed_from_weight(weighed_arm, motion, tau + friction).any()


def test_a_sine_about_the_hanging_posture_is_none(weighed_arm):
    # Its acceleration is a weight: there is nothing beside it to tell the two apart.
    w = 2 * np.pi * 0.5
    q = np.column_stack([0.05 * np.sin(w * T), np.zeros_like(T)])
    v = np.column_stack([0.05 * w * np.cos(w * T), np.zeros_like(T)])
    motion = Motion(T, q, v, -(w**2) * q)
    assert not computed_from_weight(weighed_arm, motion, inverse_dynamics(weighed_arm, motion))[0]


def test_the_weight_that_the_drive_of_a_held_joint_bears_is_none(weighed_arm):
    m = wander(2)
    motion = Motion(T, *(np.column_stack([of[:, 0], np.zeros_like(T)]) for of in (m.q, m.v, m.a)))
    assert not computed_from_weight(weighed_arm, motion, inverse_dynamics(weighed_arm, still(motion)))[1]


def test_up_alone_lifts_and_up_and_down_does_not(weighed_arm):
    up = np.column_stack([0.5 * np.pi * T / T[-1], np.zeros_like(T)])
    speed = np.column_stack([np.full_like(T, 0.5 * np.pi / T[-1]), np.zeros_like(T)])
    motion = Motion(T, up, speed, np.zeros_like(up))
    weight = inverse_dynamics(weighed_arm, still(motion))
    away = np.sign(weight[-1, 0])
    assert lifted_less_lowered(weighed_arm, motion, weight)[0] == pytest.approx(away)
    both = Motion(T, np.vstack([up[::2], up[::-2]]), np.vstack([speed[::2], -speed[::2]]), np.zeros_like(up))
    assert lifted_less_lowered(weighed_arm, both, inverse_dynamics(weighed_arm, still(both)))[0] == pytest.approx(
        0.0, abs=0.01
    )


def test_a_joint_that_stands_neither_lifts_nor_lowers_its_weight(weighed_arm):
    # Its smoothed position creeps in the last digits, in one direction.
    creep = np.full((len(T), 2), 1e-9)
    motion = Motion(T, creep * T[:, None], creep, np.zeros_like(creep))
    weight = inverse_dynamics(weighed_arm, still(motion))
    assert lifted_less_lowered(weighed_arm, motion, weight).tolist() == [0.0, 0.0]


def written(tmp_path, weighed_arm, motion: Motion, tau: np.ndarray) -> str:
    names = ",".join(f"{kind}.{joint}" for kind in ("q", "tau") for joint in weighed_arm.joint_names)
    path = tmp_path / "log.csv"
    np.savetxt(path, np.hstack([motion.t[:, None], motion.q, tau]), delimiter=",", header=f"t,{names}", comments="")
    return str(path)


@pytest.mark.nightly
@pytest.mark.whole
def test_no_load_is_certain_of_a_recorded_compensation(tmp_path, weighed_arm, rng):
    # The compensation's model is 1.3 times as heavy as the given one, a hand moves the arm.
    motion = wander(2)
    tau = 1.3 * inverse_dynamics(weighed_arm, still(motion))
    tau += 0.002 * tau.std(axis=0) * rng.standard_normal(tau.shape)
    found = dyn.diagnose(weighed_arm, written(tmp_path, weighed_arm, motion, tau))
    loads = [one for one in found.findings if one.effect in ("payload", "inertial_parameters", "torque_constant")]
    assert loads
    assert max(one.probability for one in loads) <= 0.5
    assert any("gravity compensation" in warning for warning in found.warnings)
