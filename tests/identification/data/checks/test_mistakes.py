"""Checks of a recording for wrong signs and units, motion that runs away, slow encoders and slow sampling."""

from dataclasses import replace

import numpy as np
import pytest

from by_night import by_night
from identification.data.checked_file import checked_file
from identification.data.checks.check_recording import checked
from identification.data.checks.divergence import diverged
from identification.data.checks.positions import check_frozen
from identification.data.checks.smoothed_copy import smoothed
from identification.data.checks.times_and_torques import check_clipping, check_repeated
from identification.data.mending import mended
from identification.data.reading import read_recording
from identification.data.reading import recording as read_table_of
from identification.data.recording import Recording, Table
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.errors import LogError
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion
from places import ROBOTS


def entries(recording: Recording, robot) -> list[str]:
    """The entries that each fault asks for, as a reader would find them."""
    found = checked(mended(recording, robot.prismatic), robot)
    return [fault.mend for fault in found.wrong]


def turned(recording: Recording, *, q: tuple[int, ...] = (), tau: tuple[int, ...] = ()) -> Recording:
    """The recording with the sign of some positions, with their velocities, and of some torques turned round."""
    way, pull = np.ones(recording.q.shape[1]), np.ones(recording.q.shape[1])
    way[list(q)], pull[list(tau)] = -1.0, -1.0
    assert recording.v is not None
    return replace(recording, q=recording.q * way, v=recording.v * way, tau=recording.tau * pull)


@pytest.mark.parametrize("joint", [0, 1])
def test_a_position_that_is_counted_backwards_is_refused_with_its_entry(clean, planar2, joint):
    name = planar2.joint_names[joint]
    stated = entries(turned(clean(robot=planar2), q=(joint,)), planar2)
    # Of the first joint of a chain only the signs of all its torques would do as well.
    assert any(f"q.{name}: {{from: q.{name}, sign: -1}}" in one for one in stated) or (
        joint == 0 and any(f"tau.{name}: {{from: tau.{name}, sign: -1}}" in one for one in stated)
    )


@pytest.mark.parametrize(("q", "tau"), [((1,), ()), ((), (1,))])
def test_the_sign_of_its_weight_distinguishes_a_hoists_position_from_its_torque(clean, lift, q, tau):
    # Known truth: inertia and friction change their signs with either, a constant weight only with the torque.
    (stated,) = entries(turned(clean(robot=lift), q=q, tau=tau), lift)
    assert ("q.hoist: {from: q.hoist, sign: -1}" in stated) == bool(q)
    assert ("tau.hoist: {from: tau.hoist, sign: -1}" in stated) == bool(tau)


@pytest.mark.parametrize("joint", [3, 4])
def test_an_axis_that_points_the_other_way_is_refused_with_both_entries(clean, joint):
    robot = load_robot("example:ur5")
    name = robot.joint_names[joint]
    stated = entries(turned(clean(robot=robot), q=(joint,), tau=(joint,)), robot)
    assert len(stated) == 1
    assert f"q.{name}: {{from: q.{name}, sign: -1}}, tau.{name}: {{from: tau.{name}, sign: -1}}" in stated[0]


def test_a_position_and_the_torque_of_another_joint_are_both_reported(clean):
    robot = load_robot("example:ur5")
    stated = "; ".join(entries(turned(clean(robot=robot), q=(2,), tau=(1,)), robot))
    for column in ("q.elbow_joint", "tau.shoulder_lift_joint"):
        assert f"{column}: {{from: {column}, sign: -1}}" in stated


def test_a_mistake_beside_which_much_is_left_is_a_warning(clean):
    # Known truth: the elbow's position is reversed, and its torque is half of it noise besides.
    robot = load_robot("example:ur5")
    wrong = turned(clean(robot=robot), q=(2,))
    noise = 0.8 * wrong.tau[:, 2].std() * np.random.default_rng(1).standard_normal(len(wrong.t))
    slow = np.convolve(noise, np.ones(500) / 500**0.5, mode="same")
    found = checked(replace(wrong, tau=wrong.tau + np.outer(slow, np.arange(6) == 2)), robot)
    assert found.wrong == ()
    assert any("it may be that the position of elbow_joint is counted the other way round" in w for w in found.warnings)


def test_degrees_of_one_joint_alone(clean):
    robot = load_robot("example:ur5")
    recording = clean(robot=robot)
    stated = entries(replace(recording, q=recording.q * np.where(np.arange(6) == 3, 180 / np.pi, 1.0), v=None), robot)
    assert len(stated) == 1
    assert "write q.wrist_1_joint: {from: q.wrist_1_joint, unit: deg} into" in stated[0]


@pytest.mark.parametrize("start", by_night([0.0, -180.0], 1))
def test_degrees_that_wrap(planar2, start, planar_log):
    wrapped = (np.rad2deg(planar_log.q * 3.0) - start) % 360 + start
    # Threefold positions are those of a robot whose torque is made for them.
    v = np.gradient(3.0 * planar_log.q, planar_log.t, axis=0)
    a = np.gradient(v, planar_log.t, axis=0)
    smooth = np.apply_along_axis(lambda x: np.convolve(x, np.ones(25) / 25, mode="same"), 0, a)
    tau = inverse_dynamics(planar2, Motion(planar_log.t, 3.0 * planar_log.q, v, smooth))
    stated = entries(replace(planar_log, q=wrapped, v=None, tau=tau), planar2)
    assert len(stated) == 1
    assert 'write q: {from: "q.{joint}", unit: deg}' in stated[0]


def test_degrees_and_newton_millimetres(clean):
    robot = load_robot("example:ur5")
    recording = clean(robot=robot)
    stated = entries(replace(recording, q=np.rad2deg(recording.q), v=None, tau=recording.tau * 1e3), robot)
    assert len(stated) == 2
    assert "unit: deg" in stated[0]
    assert "unit: Nmm" in stated[1] or "gear: 0.001" in stated[1]


def test_a_right_recording_of_the_same_robot_is_not_refused(clean, planar2):
    robot = load_robot("example:ur5")
    assert entries(clean(robot=robot), robot) == entries(clean(robot=planar2), planar2) == []


def test_a_zero_that_is_off_is_left_to_the_diagnosis(clean):
    robot = load_robot("example:ur5")
    recording = clean(robot=robot)
    assert entries(replace(recording, q=recording.q + np.where(np.arange(6) == 1, 0.15, 0.0)), robot) == []


@pytest.mark.parametrize("start", [0.2, 0.75])
def test_motion_that_grows_without_bound_is_reported_as_that(start, planar_log):
    t = planar_log.t
    growth = np.exp(np.maximum(t - start * t[-1], 0.0) * 3.0 / max(1 - start, 0.3)) - 1.0
    away = np.outer(growth * np.sin(60.0 * t), [0.3, 0.0])
    fault = diverged(replace(planar_log, q=planar_log.q + away, tau=planar_log.tau + 1e3 * away))
    assert fault is not None
    assert "the motion grows without bound from about t =" in fault.what
    assert ("--exclude" in fault.mend) == (start > 0.2 or "--exclude" in fault.mend)


@pytest.mark.parametrize("kind", ["spin", "spin up", "moves and rests", "degrees", "a jump of an encoder"])
def test_honest_motion_is_none_that_ran_away(kind, planar_log):
    t = planar_log.t
    q = {
        "spin": np.outer(300.0 * t, [1, 1]),
        "spin up": np.outer(40.0 * np.maximum(t - 8, 0) ** 2, [1, 1]),
        "moves and rests": planar_log.q * (t % 5 < 0.4)[:, None],
        "degrees": np.rad2deg(planar_log.q),
        "a jump of an encoder": planar_log.q + 6000.0 * (t > 9)[:, None],
    }[kind]
    assert diverged(replace(planar_log, q=q)) is None


def test_a_torque_of_no_machine_ran_away(planar_log):
    tau = planar_log.tau * np.where(planar_log.t > 15, 1e12, 1.0)[:, None]
    assert diverged(replace(planar_log, tau=tau)) is not None


@pytest.mark.parametrize("beyond", [np.inf, np.nan, 1e12])
def test_what_diverged_beyond_all_sensors_is_reported_so_and_may_be_left_out(planar2, planar_log, tmp_path, beyond):
    # Known truth: the log ends with 20 rows of values that grow, and 10 that no sensor gives.
    q, tau, t = np.array(planar_log.q), np.array(planar_log.tau), planar_log.t
    q[-30:, 1] += 3.0 ** np.minimum(np.arange(30), 12)
    tau[-10:, 0] = beyond
    names = [f"{kind}.{joint}" for kind in ("q", "tau") for joint in planar2.joint_names]
    log = tmp_path / "log.csv"
    np.savetxt(log, np.column_stack([t, q, tau]), delimiter=",", header=",".join(["t", *names]), comments="")
    for robot in (planar2, None):
        (fault,) = checked_file(log, robot).wrong
        assert "the motion grows without bound from about t =" in fault.what
    assert read_recording(log, planar2, excluded=[(float(t[-32]), float(t[-1]))]).wrong == ()
    # Single values of that size are mistakes of the file.
    np.savetxt(log, np.column_stack([t, planar_log.q, tau]), delimiter=",", header=",".join(["t", *names]), comments="")
    with pytest.raises(LogError, match=rf"column tau\.{planar2.joint_names[0]} is"):
        read_recording(log, planar2)


def test_torques_below_a_dead_band_are_named(planar2, planar_log):
    tau = np.array(planar_log.tau)
    tau[np.abs(tau[:, 1]) < np.percentile(np.abs(tau[:, 1]), 85), 1] = 0.0
    (stated,) = check_repeated(replace(planar_log, tau=tau)).values()
    assert stated.startswith(f"clean.csv: tau.{planar2.joint_names[1]} is exactly 0 in 85 % of the rows")


@pytest.mark.parametrize(("value", "share"), [(0.0, 0.3), (1.234, 0.8), (0.0, 0.08)])
def test_rows_whose_torque_was_not_read_are_named(planar2, planar_log, rng, value, share):
    # Known truth: a torque that is lost in scattered rows.
    tau, lost = np.array(planar_log.tau), rng.random(len(planar_log.t)) < share
    tau[lost, 1] = value
    recording = replace(planar_log, tau=tau)
    (stated,) = check_repeated(recording).values()
    assert stated.startswith(
        f"clean.csv: tau.{planar2.joint_names[1]} is exactly {value:g} in {100 * lost.mean():.0f} %"
    )
    assert "these rows are no readings of its torque" in stated
    assert check_clipping(recording) == ()


@pytest.mark.parametrize(("value", "percent"), [(0.0, 35), (-0.037, 80)])
def test_dead_bands_below_half_of_the_rows_or_beside_zero_are_named(planar_log, value, percent):
    tau = np.array(planar_log.tau)
    tau[np.abs(tau[:, 1]) < np.percentile(np.abs(tau[:, 1]), percent), 1] = value
    (stated,) = check_repeated(replace(planar_log, tau=tau)).values()
    assert f"is exactly {value:g} in {percent} % of the rows" in stated
    assert "its drive reports small torques as none" in stated


def test_torques_repeat_where_they_are_coarse_limited_or_at_rest(planar_log):
    tau, t = planar_log.tau, planar_log.t
    size = tau.std(axis=0)
    rests = (t % 2 < 1)[:, None]
    q = np.where(rests, planar_log.q[0], planar_log.q)
    for honest in (
        replace(planar_log, tau=np.round(tau / size) * size),
        replace(planar_log, tau=np.round(tau / (0.2 * size)) * 0.2 * size),
        replace(planar_log, tau=np.clip(tau, -0.5 * size, 0.5 * size)),
        replace(planar_log, tau=np.where(rests, 0.0, tau), q=q),
    ):
        assert check_repeated(honest) == {}


def test_a_drive_that_is_off_for_most_of_the_time_and_pulses_are_no_dead_band(planar_log):
    off = np.where(planar_log.t[:, None] < 15, 0.0, planar_log.tau)
    pulses = np.outer(3.0 * (np.sin(2.0 * planar_log.t) > 0.5), [1, 1])
    assert check_repeated(replace(planar_log, tau=off)) == check_repeated(replace(planar_log, tau=pulses)) == {}


def test_rests_and_reversals_are_no_slow_encoder_and_a_slow_one_is(planar_log):
    step = 1e-3
    t = planar_log.t
    rests = np.sin(np.clip(t - 4, 0, 11))[:, None] * np.ones(2)
    coarse = replace(planar_log, q=np.round(rests / step) * step)
    smooth = smoothed(coarse)
    assert smooth is not None
    assert check_frozen(coarse, smooth) == ()
    stalls = np.array(planar_log.q)
    for row in range(500, 9000, 40):
        stalls[row : row + 6] = stalls[row]
    slow = replace(planar_log, q=stalls)
    smooth = smoothed(slow)
    assert smooth is not None
    assert len(check_frozen(slow, smooth)) == 2


def test_all_missing_joints_are_listed():
    robot = load_robot("example:ur5")
    n = np.arange(100.0)
    table = Table("log.csv", {"t": n, **{f"{x}.wrist_1_joint": n for x in ("q", "tau")}})
    stated = r"log\.csv lacks the positions of 5 of the 6 joints of ur5\w*: q\.shoulder_pan_joint, .* lock: \[shoulder"
    with pytest.raises(LogError, match=stated):
        read_table_of(table, robot)


def test_what_is_left_out_sets_no_scale():
    robot = load_robot(ROBOTS / "planar2.urdf")
    t = np.arange(2000) * 0.01
    columns = {f"{x}.{joint}": np.sin(t) for x in ("q", "tau") for joint in robot.joint_names}
    wild = {name: np.where(t > 15, 1e7, np.where((t > 5) & (t < 6), -1e7, values)) for name, values in columns.items()}
    found = read_table_of(Table("log.csv", {"t": t, **wild}), robot, excluded=((5, 6), (15, 21)))
    assert np.abs(found.q).max() <= 1.0
    assert found.t[-1] <= 15


def swings(robot: Robot, t: np.ndarray, slowest_hz: float, noise: float = 0.0) -> Recording:
    """Two sines a joint, of the given frequency and twice to three times it, with the torque that they need."""
    q, v, a = (np.zeros((len(t), robot.nv)) for _ in range(3))
    for j in range(robot.nv):
        for f in (slowest_hz, (2.1 + 0.3 * j) * slowest_hz):
            w = 2 * np.pi * f
            q[:, j] += 0.2 * np.sin(w * t + j)
            v[:, j] += 0.2 * w * np.cos(w * t + j)
            a[:, j] -= 0.2 * w**2 * np.sin(w * t + j)
    rng = np.random.default_rng(0)
    tau = inverse_dynamics(robot, Motion(t, q, v, a))
    tau += 0.01 * tau.std(axis=0) * rng.standard_normal(tau.shape)
    return Recording("log.csv", robot.joint_names, t, q + noise * rng.standard_normal(q.shape), tau)


@pytest.mark.parametrize(
    ("rate", "seconds", "slowest_hz"),
    [(1.0, 3600.0, 0.01), (10.0, 7200.0, 0.05), (20_000.0, 4.0, 1.0)],
    ids=["one hertz", "two hours", "20 kHz"],
)
def test_any_rate_that_follows_the_motion_is_fine(arm, rate, seconds, slowest_hz):
    assert checked(swings(arm, np.arange(int(seconds * rate)) / rate, slowest_hz), arm).warnings == ()


def test_a_motion_that_is_sampled_too_slowly_is_reported_and_is_no_standstill(arm):
    # Sines of 0.4 Hz and more, sampled once a second: the positions are those of noise.
    said = checked(swings(arm, np.arange(300.0), 0.4), arm).warnings
    assert not [sentence for sentence in said if "never moves" in sentence or "no joint moves" in sentence]
    (one,) = [sentence for sentence in said if "jump about" in sentence]
    assert one.startswith("log.csv: the positions of turn, tilt, slide jump about from sample to sample")
    assert one.endswith("record with far more than 1 Hz, or move more slowly.")


def test_a_joint_that_rests_with_a_noisy_encoder_never_moves(arm, changed):
    recording = swings(arm, np.arange(4000) / 200, 0.5)
    resting = recording.q.copy()
    resting[:, 0] = 0.3 + 2e-3 * np.random.default_rng(1).standard_normal(4000)
    said = checked(changed(recording, q=resting), arm).warnings
    assert any("turn never moves" in sentence for sentence in said)
