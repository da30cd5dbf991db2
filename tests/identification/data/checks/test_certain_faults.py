"""Recordings that are certainly wrong, and strange ones that are not. Oracle: known truth; the wrong is put in."""

import re
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from by_night import by_night
from identification.data.checks.check_recording import checked
from identification.data.checks.readings.reading import reading_of
from identification.data.checks.readings.weights import compensated_suspects, gravity_from_torques
from identification.data.checks.smoothed_copy import smoothed
from identification.data.reading import read_recording
from identification.data.recording import Fault, Recording
from phantom_dyn.dynamics.dynamics import gravity_torque, inverse_dynamics
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion
from places import ROBOTS


def only(wrong: tuple[Fault, ...]) -> Fault:
    """The one fault that there is."""
    assert len(wrong) == 1, wrong
    return wrong[0]


def loaded(robot: Robot, mass: float) -> Robot:
    """The robot with a ball on its last link."""
    out = replace(robot)
    at = pin.SE3(np.eye(3), np.array([0.2, 0.1, 0.0]))
    out.model.appendBodyToJoint(robot.model.njoints - 1, pin.Inertia.FromSphere(mass, 0.05), at)
    return out


def with_inertias(robot: Robot, factors: tuple[float, ...]) -> Robot:
    """The robot with every link's inertia times a factor."""
    out = replace(robot)
    for k, factor in enumerate(factors, start=1):
        out.model.inertias[k] = pin.Inertia.FromDynamicParameters(factor * out.model.inertias[k].toDynamicParameters())
    return out


def slow(clean, robot: Robot, times: float) -> Recording:
    """The motion of a clean recording at 200 Hz, so many times more slowly, with its torque."""
    recording = clean(rate=200.0, seconds=20.0)
    motion = smooth_motion(recording)
    slower = Motion(motion.t * times, motion.q, motion.v / times, motion.a / times**2)
    return replace(recording, t=slower.t, q=slower.q, v=None, tau=inverse_dynamics(robot, slower))


def smooth_motion(recording: Recording) -> Motion:
    copy = smoothed(recording)
    return Motion(copy.t, copy.q, copy.v, copy.a)


@pytest.mark.parametrize(
    ("name", "factor", "what", "mend"),
    by_night(
        [
            (
                "q",
                np.rad2deg([1, 1, np.deg2rad(1)]),
                "the positions of turn, tilt are in degrees and not in rad",
                "{q.turn: {from: q.turn, unit: deg}, q.tilt: {from: q.tilt, unit: deg}}",
            ),
            (
                "t",
                1e3,
                "the time is in ms and not in s",
                "write t: {from: t, unit: ms} into a column map and give it with",
            ),
            (
                "t",
                1e6,
                "the time is in us and not in s",
                "write t: {from: t, unit: us} into a column map and give it with",
            ),
            ("tau", [-1, 1, 1], "the torque of turn has the wrong sign", "tau.turn: {from: tau.turn, sign: -1}"),
            ("tau", [1, -1, 1], "the torque of tilt has the wrong sign", "tau.tilt: {from: tau.tilt, sign: -1}"),
            ("tau", [1, 1, -1], "the torque of slide has the wrong sign", "tau.slide: {from: tau.slide, sign: -1}"),
            (
                "tau",
                [-1, -1, -1],
                "the torques of all joints have the wrong sign",
                'tau: {from: "tau.{joint}", sign: -1}',
            ),
        ],
        0,
        1,
        4,
        6,
    ),
)
def test_a_wrong_unit_or_sign_is_reported_with_its_entry(arm, changed, name, factor, what, mend, recording):
    fault = only(checked(changed(recording, **{name: getattr(recording, name) * factor}), arm).wrong)
    assert fault.what == what
    assert mend in fault.mend


def test_a_slow_motion_in_ms_is_reported_although_it_shows_no_inertia(clean, arm, changed):
    # Ten times slower, inertia is a hundredth of what it was; friction and weight fit in either unit.
    recording = slow(clean, arm, 10.0)
    fault = only(checked(changed(recording, t=recording.t * 1e3), arm).wrong)
    assert fault.what == "the time is in ms and not in s"
    assert "a sample comes every 50 s" in fault.why


def test_times_that_count_rows_may_be_milliseconds_or_no_times(clean, arm, changed):
    recording = clean(rate=1000.0)
    fault = only(checked(replace(recording, t=np.arange(1.0, len(recording.t) + 1), v=None), arm).wrong)
    assert "write t: {from: t, unit: ms}" in fault.mend
    assert fault.mend.endswith("write ignore: [t] and rate: <rows per second> into the column map")


def test_a_motion_that_is_really_so_slow_is_right(clean, arm):
    # Sampled every two seconds; read as milliseconds its inertia would be a million times as large.
    assert checked(slow(clean, arm, 400.0), arm).wrong == ()


def test_two_flipped_torques_are_both_reported(arm, changed, recording):
    wrong = checked(changed(recording, tau=recording.tau * [1, -1, -1]), arm).wrong
    assert {fault.what for fault in wrong} == {
        "the torque of tilt has the wrong sign",
        "the torque of slide has the wrong sign",
    }


def test_swapped_torques(arm, changed, recording):
    fault = only(checked(changed(recording, tau=recording.tau[:, [1, 0, 2]]), arm).wrong)
    assert fault.what == "the torques of turn and tilt are swapped"
    assert "{tau.turn: tau.tilt, tau.tilt: tau.turn}" in fault.mend


def test_swapped_positions(planar2, changed, planar_log):
    fault = only(checked(changed(planar_log, q=planar_log.q[:, [1, 0]], v=planar_log.v[:, [1, 0]]), planar2).wrong)
    assert fault.what == "the positions of shoulder and elbow are swapped"


def test_positions_and_torques_in_each_others_columns(clean, arm, planar2, changed):
    for robot in (arm, planar2):
        recording = clean(robot=robot)
        fault = only(checked(changed(recording, q=recording.tau, tau=recording.q), robot).wrong)
        assert fault.what == "positions and torques are in each other's columns"
        assert 'write {q: "tau.{joint}", tau: "q.{joint}"} into a column map' in fault.mend


def test_torques_in_another_unit(planar2, changed, planar_log):
    fault = only(checked(changed(planar_log, tau=1e3 * planar_log.tau), planar2).wrong)
    assert fault.what == "the torques are in Nmm and not in N m"


def test_the_torques_of_two_joints_in_another_unit_of_which_a_load_makes_one_larger(clean, arm, changed):
    # Known truth: N mm on two of three joints; the first one's size alone shows its unit.
    recording = clean(robot=loaded(arm, 0.5))
    fault = only(checked(changed(recording, tau=recording.tau * [1e3, 1e3, 1.0]), arm).wrong)
    assert fault.what == "the torques of turn, tilt are in Nmm and not in N m"


@pytest.mark.parametrize(("unit", "factor"), [("Nmm", 1e3), ("Ncm", 1e2)])
def test_the_torque_of_one_joint_in_another_unit(planar2, changed, unit, factor, planar_log):
    fault = only(checked(changed(planar_log, tau=planar_log.tau * [1.0, factor]), planar2).wrong)
    assert fault.what == f"the torque of elbow is in {unit} and not in N m"
    assert f"tau.elbow: {{from: tau.elbow, unit: {unit}}}" in fault.mend


def test_the_torque_of_one_joint_on_the_side_of_its_motor_with_stated_gears(planar2, changed, planar_log):
    robot = replace(planar2, actuators=tuple(replace(a, gear_ratio=60.0) for a in planar2.actuators))
    fault = only(checked(changed(planar_log, tau=planar_log.tau / [60.0, 1.0]), robot).wrong)
    assert fault.what == "the torque of shoulder is on the motor's side of the gear"
    assert "tau.shoulder: {from: tau.shoulder, gear: 60}" in fault.mend


@pytest.mark.parametrize("ratio", [101.0, -50.0, 12.0])
def test_the_position_of_a_motor_behind_an_unknown_gear(planar2, changed, ratio, planar_log):
    # Known truth: the elbow's motor turns so many times as far as the elbow, or the other way round.
    fault = only(checked(replace(changed(planar_log, q=planar_log.q * [1.0, ratio]), v=None), planar2).wrong)
    assert fault.what.startswith("the position of elbow is on the motor's side of a gear of about ")
    assert float(re.search(r"gear: ([\d.]+)", fault.mend)[1]) == pytest.approx(abs(ratio), rel=0.02)
    assert ("sign: -1" in fault.mend) == (ratio < 0)


def test_the_positions_of_all_motors_behind_gears_of_one_ratio(arm, changed, recording):
    fault = only(checked(replace(changed(recording, q=recording.q * [-100, -100, 1]), v=None), arm).wrong)
    assert fault.what.startswith("the positions of turn, tilt are on the motor's side of a gear of about 1")
    assert "sign: -1" in fault.mend


def test_the_positions_of_motors_behind_gears_of_their_own(clean):
    # Known truth: six gears. Of a wrist with next to no weight the ratio shows little.
    robot, gears = load_robot("example:ur5"), np.array([100.0, 100.0, 80.0, 50.0, 50.0, 50.0])
    recording = clean(robot=robot)
    fault = only(checked(replace(recording, q=recording.q * gears, v=None), robot).wrong)
    for joint, gear in list(zip(robot.joint_names, gears, strict=True))[:4]:
        assert float(re.search(rf"q.{joint}, gear: ([\d.]+)", fault.mend)[1]) == pytest.approx(gear, rel=0.1)


@pytest.mark.parametrize(("ratio", "entry"), [(61.0, "gear: 6"), (180 / np.pi, "unit: deg")])
def test_a_gear_of_about_57_is_distinguished_from_degrees_also_with_a_load(clean, ratio, entry):
    robot, name = load_robot("example:ur5"), "elbow_joint"
    recording = clean(robot=loaded(load_robot("example:ur5"), 2.0))
    fault = only(checked(replace(recording, q=recording.q * [1.0, 1.0, ratio, 1.0, 1.0, 1.0], v=None), robot).wrong)
    assert f"q.{name}: {{from: q.{name}, {entry}" in fault.mend


def test_a_slide_that_its_motor_counts_is_not_taken_for_millimetres(clean, lift):
    # Known truth: 392.7 rad/m, a screw of 16 mm a turn.
    recording = clean(robot=lift)
    fault = only(checked(replace(recording, q=recording.q * [1.0, 392.7], v=None), lift).wrong)
    assert float(re.search(r"q.hoist, gear: ([\d.]+)", fault.mend)[1]) == pytest.approx(392.7, rel=0.1)


def test_degrees_of_some_joints_of_which_one_has_another_mistake(arm, changed, recording):
    q, tau = recording.q * [np.rad2deg(1), np.rad2deg(1), 1], recording.tau * [1, -1, 1]
    wrong = checked(replace(changed(recording, q=q, tau=tau), v=None), arm).wrong
    assert [fault.what for fault in wrong] == [
        "the positions of turn, tilt are in degrees and not in rad",
        "the torque of tilt has the wrong sign",
    ]


def test_torques_on_the_side_of_the_motor_with_stated_gears(planar2, changed, planar_log):
    gears = (50.0, 30.0)
    actuators = tuple(replace(a, gear_ratio=g) for a, g in zip(planar2.actuators, gears, strict=True))
    fault = only(checked(changed(planar_log, tau=planar_log.tau / gears), replace(planar2, actuators=actuators)).wrong)
    assert fault.what == "the torques are on the motor's side of the gears"
    assert "{from: tau.shoulder, gear: 50}, tau.elbow: {from: tau.elbow, gear: 30}" in fault.mend


def test_torques_on_the_side_of_the_motor_of_unknown_gears(planar2, changed, planar_log):
    fault = only(checked(changed(planar_log, tau=planar_log.tau / 100), planar2).wrong)
    assert "on the motor's side of gears of about" in fault.what


def test_a_load_on_a_light_arm_is_no_current(clean, planar2):
    # The elbow carries ten times its own mass, and its torque is many times the modelled one, rightly.
    recording = clean(robot=loaded(load_robot(ROBOTS / "planar2.urdf"), 4.0))
    assert not [words for words in checked(recording, planar2).warnings if "current" in words]


def test_a_torque_from_a_current_is_mended_where_it_comes_from(arm, changed, recording):
    current = replace(changed(recording, tau=recording.tau * [1, -1, 1]), torque_from={"turn": "tau", "tilt": "i"})
    assert "the torque was computed from i.tilt" in only(checked(current, arm).wrong).mend


def compensated(clean, arm: Robot) -> tuple[Recording, Robot]:
    recording = clean()
    return replace(recording, tau=recording.tau - gravity_torque(arm, recording.q)), arm


def noisy(clean, arm: Robot) -> tuple[Recording, Robot]:
    recording = clean()
    noise = np.random.default_rng(1).standard_normal(recording.tau.shape)
    return replace(recording, tau=recording.tau + noise * recording.tau.std(axis=0)), arm


def turned(clean, arm: Robot) -> tuple[Recording, Robot]:
    recording, zero = clean(), np.array([0, np.pi, 0])
    return replace(recording, q=recording.q + zero), arm


def undriven(clean, arm: Robot) -> tuple[Recording, Robot]:
    recording = clean()
    noise = 1e-3 * recording.tau.std(axis=0)[1] * np.random.default_rng(1).standard_normal(len(recording.t))
    return replace(recording, tau=np.column_stack([recording.tau[:, 0], noise, recording.tau[:, 2]])), arm


def times(clean, arm: Robot, *factors: float) -> tuple[Recording, Robot]:
    recording = clean()
    return replace(recording, tau=recording.tau * factors), arm


def all_at_once(clean, arm: Robot) -> tuple[Recording, Robot]:
    heavy = clean(robot=loaded(arm, 5.0), friction=8.0)
    return replace(heavy, tau=heavy.tau * [2.0, 0.5, 1.5]), with_inertias(arm, (0.5, 2.0, 0.5))


STRANGE = {
    "a load that is heavier than the robot": lambda clean, arm: (clean(robot=loaded(arm, 5.0)), arm),
    "friction that is larger than the weight": lambda clean, arm: (clean(friction=40.0), arm),
    "inertias that are twofold wrong": lambda clean, arm: (clean(), with_inertias(arm, (2.0, 0.5, 2.0))),
    "torque constants from a half to two": lambda clean, arm: times(clean, arm, 0.5, 2.0, 0.7),
    "all of this at once": all_at_once,
    "gravity compensated": compensated,
    "noise as large as the torque": noisy,
    "a joint without drive": undriven,
    "a zero that is elsewhere": turned,
}


@pytest.mark.parametrize("what", STRANGE)
def test_what_is_only_strange_is_not_certainly_wrong(clean, arm, what):
    recording, robot = STRANGE[what](clean, arm)
    assert checked(recording, robot).wrong == ()


@pytest.mark.parametrize("friction", [1.3, 4.0])
def test_a_torque_from_which_gravity_was_taken_is_refused_with_the_entry(clean, planar2, friction):
    # Known truth: the model lacks most of the friction, which a factor on all torques would explain as well.
    recording = clean(robot=planar2, friction=friction)
    compensated = replace(recording, tau=recording.tau - gravity_torque(planar2, recording.q))
    fault = only(checked(compensated, planar2).wrong)
    assert fault.what == "the torques of shoulder, elbow lack the weight of the links that the model has"
    assert "write tau: {compensated: gravity} into a column map" in fault.mend
    assert "state gravity in robot.yaml" in fault.mend


def test_a_torque_of_one_joint_without_gravity_is_refused_with_its_entry(clean, planar2):
    recording = clean(robot=planar2)
    taken = gravity_torque(planar2, recording.q) * [1.0, 0.0]
    fault = only(checked(replace(recording, tau=recording.tau - taken), planar2).wrong)
    assert fault.what == "the torque of shoulder lacks the weight of the links that the model has"
    assert "or a counterbalance carries the links, write tau.shoulder: {compensated: gravity} into" in fault.mend


def test_a_robot_that_stands_askew_lacks_no_weight(clean, planar2):
    askew = replace(planar2)
    askew.model.gravity.linear = pin.exp3(np.array([0.0, 0.5, 0.0])) @ askew.model.gravity.linear
    assert checked(clean(robot=planar2), askew).warnings == ()


@pytest.mark.parametrize(("taken", "felt"), [(0.0, 9.81), (1.0, 0.0)])
def test_the_gravity_that_the_torques_feel(planar2, taken, felt, planar_log):
    tau = planar_log.tau - taken * gravity_torque(planar2, planar_log.q)
    reading = reading_of(smoothed(replace(planar_log, tau=tau)))
    assert np.linalg.norm(gravity_from_torques(planar2, reading, (0, 1))) == pytest.approx(felt, abs=0.1)


@pytest.mark.parametrize("constant", [0.0, 1.5])
def test_a_joint_that_a_brake_holds_says_nothing_about_the_weight(planar2, constant, planar_log):
    # Closed form: the other joint lacks all of its weight; a torque that does not vary is no sign of either.
    tau = planar_log.tau - gravity_torque(planar2, planar_log.q)
    reading = reading_of(smoothed(replace(planar_log, tau=np.column_stack([np.full(len(tau), constant), tau[:, 1]]))))
    assert [suspect.joints for suspect in compensated_suspects(planar2, reading)] == [(1,)]


def test_torques_without_sign_are_refused_as_that(arm, recording):
    fault = only(checked(replace(recording, tau=np.abs(recording.tau)), arm).wrong)
    assert fault.what == "the torques of turn, tilt, slide have no sign"
    assert "record the torque with its sign" in fault.mend


def test_magnitudes_with_the_sign_of_the_velocity_are_warned_of(planar2, planar_log):
    # A gear that locks itself needs torques along the velocity alone, too, so that it is not certain.
    signed = np.abs(planar_log.tau) * np.sign(np.gradient(planar_log.q, axis=0))
    found = checked(replace(planar_log, tau=signed), planar2)
    assert found.wrong == ()
    assert "the torques of shoulder, elbow never brake the motion" in " ".join(found.warnings)


def test_a_torque_that_only_weight_keeps_positive_has_its_sign(planar2, planar_log):
    # Known truth: the joint hangs to one side, and the model needs no other sign.
    tau = planar_log.tau + 2 * np.abs(planar_log.tau).max(axis=0)
    assert checked(replace(planar_log, tau=tau), planar2).wrong == ()


@pytest.mark.parametrize("run", ["0kg", "1kg", "2kg"])
def test_a_heavy_load_on_a_light_lever_is_not_certainly_wrong(data_folder, run):
    # Published: 2 kg on a lever of 0.078 kg.
    folder = data_folder / "go1_pendulum"
    if not folder.exists():
        pytest.skip("this recording is not part of the public folder")
    robot = load_robot(folder / "robot.urdf")
    assert read_recording(folder / f"sin_sin_{run}.csv", robot).wrong == ()


def test_a_pendulum_in_another_unit_may_carry_a_load(clean, changed):
    robot = load_robot(ROBOTS / "pendulum.urdf")
    recording = clean(robot=robot)
    assert checked(changed(recording, tau=1e3 * recording.tau), robot).wrong == ()


def test_a_torque_that_nobody_recorded_is_refused_with_the_entries_that_leave_it_out(arm, changed, recording):
    tau = recording.tau.copy()
    tau[:, 1] = 0.0
    fault = only(checked(changed(recording, tau=tau), arm).wrong)
    assert fault.what == f"the torque of {arm.joint_names[1]} is 0 in every row"
    assert f"{arm.joint_names[1]}: {{drive: unknown}}" in fault.mend


def test_a_joint_that_swings_by_itself_needs_no_torque(planar2, changed, planar_log):
    # Known truth: the elbow moves as gravity and the shoulder make it, by Pinocchio's equations of motion.
    rate, seconds = 500.0, 20.0
    t = np.arange(int(rate * seconds)) / rate
    shoulder, speed, acceleration = (0.5 * np.sin(2 * t), np.cos(2 * t), -2 * np.sin(2 * t))
    q, v, data = np.array([0.0, 1.5]), np.array([1.0, 0.0]), planar2.model.createData()
    way = np.zeros((len(t), 2))
    for k, (place, quick, quicker) in enumerate(zip(shoulder, speed, acceleration, strict=True)):
        q[0], v[0] = place, quick
        way[k] = q
        M, b = pin.crba(planar2.model, data, q), pin.nle(planar2.model, data, q, v)
        v[1] += -(b[1] + M[1, 0] * quicker) / M[1, 1] / rate
        q[1] += v[1] / rate
    drive = np.zeros_like(way)
    drive[:, 0] = 1.0 + np.sin(2 * t)
    free = replace(planar2, viscous_friction=np.zeros(2), coulomb_friction=np.zeros(2))
    wrong = checked(changed(replace(planar_log, v=None), t=t, q=way, tau=drive), free).wrong
    assert not any("0 in every row" in fault.what for fault in wrong)
