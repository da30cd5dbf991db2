"""Checks of a recording for mistakes: units, range, sampling, passive joints."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from identification.data.checks.beyond_range import beyond_range
from identification.data.checks.check_recording import check_recording, checked
from identification.data.checks.model_units import wrong_units
from identification.data.checks.positions import check_frozen
from identification.data.checks.runaway import ran_away
from identification.data.checks.smoothed_copy import smoothed
from identification.data.checks.times_and_torques import check_zeros
from identification.data.mending import mended
from identification.data.reading import recording as read_table_of
from identification.data.recording import Recording, Table
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.errors import LogError
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Robot
from phantom_dyn.model.robot_files import builtin_robots
from phantom_dyn.motion import Motion
from places import CHECKOUT, ROBOTS


def entries(recording: Recording, robot) -> list[str]:
    """What a user is told to write, one text a fault, as a reader would find it."""
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
    told = entries(turned(clean(robot=planar2), q=(joint,)), planar2)
    # Of the first joint of a chain only the signs of all its torques would do as well.
    assert any(f"q.{name}: {{from: q.{name}, sign: -1}}" in one for one in told) or (
        joint == 0 and any(f"tau.{name}: {{from: tau.{name}, sign: -1}}" in one for one in told)
    )


@pytest.mark.parametrize("joint", [3, 4])
def test_an_axis_that_points_the_other_way_is_refused_with_both_entries(clean, joint):
    robot = load_robot("example:ur5")
    name = robot.joint_names[joint]
    told = entries(turned(clean(robot=robot), q=(joint,), tau=(joint,)), robot)
    assert len(told) == 1
    assert f"q.{name}: {{from: q.{name}, sign: -1}}, tau.{name}: {{from: tau.{name}, sign: -1}}" in told[0]


def test_a_position_and_the_torque_of_another_joint_are_both_told(clean):
    robot = load_robot("example:ur5")
    told = "; ".join(entries(turned(clean(robot=robot), q=(2,), tau=(1,)), robot))
    for column in ("q.elbow_joint", "tau.shoulder_lift_joint"):
        assert f"{column}: {{from: {column}, sign: -1}}" in told


def test_degrees_of_one_joint_alone(clean):
    robot = load_robot("example:ur5")
    recording = clean(robot=robot)
    told = entries(replace(recording, q=recording.q * np.where(np.arange(6) == 3, 180 / np.pi, 1.0), v=None), robot)
    assert len(told) == 1
    assert "write q.wrist_1_joint: {from: q.wrist_1_joint, unit: deg} into" in told[0]


@pytest.mark.parametrize("start", [0.0, -180.0])
def test_degrees_that_wrap(clean, planar2, start):
    recording = clean(robot=planar2)
    wrapped = (np.rad2deg(recording.q * 3.0) - start) % 360 + start
    # Threefold positions are those of a robot whose torque is made for them.
    robot, t = planar2, recording.t
    from phantom_dyn.dynamics.dynamics import inverse_dynamics
    from phantom_dyn.motion import Motion

    v = np.gradient(3.0 * recording.q, t, axis=0)
    a = np.gradient(v, t, axis=0)
    smooth = np.apply_along_axis(lambda x: np.convolve(x, np.ones(25) / 25, mode="same"), 0, a)
    tau = inverse_dynamics(robot, Motion(t, 3.0 * recording.q, v, smooth))
    told = entries(replace(recording, q=wrapped, v=None, tau=tau), robot)
    assert len(told) == 1
    assert 'write q: {from: "q.{joint}", unit: deg}' in told[0]


def test_degrees_and_newton_millimetres(clean):
    robot = load_robot("example:ur5")
    recording = clean(robot=robot)
    told = entries(replace(recording, q=np.rad2deg(recording.q), v=None, tau=recording.tau * 1e3), robot)
    assert len(told) == 2
    assert "unit: deg" in told[0]
    assert "unit: Nmm" in told[1] or "gear: 0.001" in told[1]


def test_a_right_recording_of_the_same_robot_is_not_refused(clean, planar2):
    robot = load_robot("example:ur5")
    assert entries(clean(robot=robot), robot) == entries(clean(robot=planar2), planar2) == []


def test_a_zero_that_is_off_is_left_to_the_diagnosis(clean):
    robot = load_robot("example:ur5")
    recording = clean(robot=robot)
    assert entries(replace(recording, q=recording.q + np.where(np.arange(6) == 1, 0.15, 0.0)), robot) == []


@pytest.mark.parametrize("start", [0.2, 0.75])
def test_motion_that_grows_without_bound_is_told_as_that(clean, planar2, start):
    recording = clean(robot=planar2)
    t = recording.t
    growth = np.exp(np.maximum(t - start * t[-1], 0.0) * 3.0 / max(1 - start, 0.3)) - 1.0
    away = np.outer(growth * np.sin(60.0 * t), [0.3, 0.0])
    fault = ran_away(replace(recording, q=recording.q + away, tau=recording.tau + 1e3 * away))
    assert fault is not None
    assert "the motion grows without bound from about t =" in fault.what
    assert ("--exclude" in fault.mend) == (start > 0.2 or "--exclude" in fault.mend)


@pytest.mark.parametrize("kind", ["spin", "spin up", "moves and rests", "degrees", "a jump of an encoder"])
def test_honest_motion_is_none_that_ran_away(clean, planar2, kind):
    recording = clean(robot=planar2)
    t = recording.t
    q = {
        "spin": np.outer(300.0 * t, [1, 1]),
        "spin up": np.outer(40.0 * np.maximum(t - 8, 0) ** 2, [1, 1]),
        "moves and rests": recording.q * (t % 5 < 0.4)[:, None],
        "degrees": np.rad2deg(recording.q),
        "a jump of an encoder": recording.q + 6000.0 * (t > 9)[:, None],
    }[kind]
    assert ran_away(replace(recording, q=q)) is None


def test_a_torque_of_no_machine_ran_away(clean, planar2):
    recording = clean(robot=planar2)
    tau = recording.tau * np.where(recording.t > 15, 1e12, 1.0)[:, None]
    assert ran_away(replace(recording, tau=tau)) is not None


def test_torques_below_a_dead_band_are_named(clean, planar2):
    recording = clean(robot=planar2)
    tau = np.array(recording.tau)
    tau[np.abs(tau[:, 1]) < np.percentile(np.abs(tau[:, 1]), 85), 1] = 0.0
    (told,) = check_zeros(replace(recording, tau=tau))
    assert told.startswith(f"clean.csv: tau.{planar2.joint_names[1]} is exactly 0 in 85 % of the rows")


def test_a_drive_that_is_off_for_most_of_the_time_and_pulses_are_no_dead_band(clean, planar2):
    recording = clean(robot=planar2)
    off = np.where(recording.t[:, None] < 15, 0.0, recording.tau)
    pulses = np.outer(3.0 * (np.sin(2.0 * recording.t) > 0.5), [1, 1])
    assert check_zeros(replace(recording, tau=off)) == check_zeros(replace(recording, tau=pulses)) == ()


def test_rests_and_reversals_are_no_slow_encoder_and_a_slow_one_is(clean, planar2):
    recording = clean(robot=planar2)
    step = 1e-3
    t = recording.t
    rests = np.sin(np.clip(t - 4, 0, 11))[:, None] * np.ones(2)
    coarse = replace(recording, q=np.round(rests / step) * step)
    smooth = smoothed(coarse)
    assert smooth is not None
    assert check_frozen(coarse, smooth) == ()
    stalls = np.array(recording.q)
    for row in range(500, 9000, 40):
        stalls[row : row + 6] = stalls[row]
    slow = replace(recording, q=stalls)
    smooth = smoothed(slow)
    assert smooth is not None
    assert len(check_frozen(slow, smooth)) == 2


def test_all_missing_joints_are_listed():
    robot = load_robot("example:ur5")
    n = np.arange(100.0)
    table = Table("log.csv", {"t": n, **{f"{x}.wrist_1_joint": n for x in ("q", "tau")}})
    told = r"log\.csv lacks the positions of 5 of the 6 joints of ur5\w*: q\.shoulder_pan_joint, .* lock: \[shoulder"
    with pytest.raises(LogError, match=told):
        read_table_of(table, robot)


def test_what_is_left_out_sets_no_scale():
    robot = load_robot(ROBOTS / "planar2.urdf")
    t = np.arange(2000) * 0.01
    columns = {f"{x}.{joint}": np.sin(t) for x in ("q", "tau") for joint in robot.joint_names}
    wild = {name: np.where(t > 15, 1e7, np.where((t > 5) & (t < 6), -1e7, values)) for name, values in columns.items()}
    found = read_table_of(Table("log.csv", {"t": t, **wild}), robot, excluded=((5, 6), (15, 21)))
    assert np.abs(found.q).max() <= 1.0
    assert found.t[-1] <= 15


BODY = """<robot name="one"><link name="base"/><link name="body"><inertial>
<origin xyz="{at} 0 0"/><mass value="{mass}"/>
<inertia ixx="{i}" iyy="{i}" izz="{i}" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="pin" type="revolute"><parent link="base"/><child link="body"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="9" velocity="9"/></joint></robot>"""


def in_units(text: str, *, length: float = 1.0, mass: float = 1.0, inertia: float | None = None) -> str:
    """A URDF whose numbers are so many times as large; inertias go with mass and length unless they are named."""
    inertia = mass * length**2 if inertia is None else inertia
    text = re.sub(r'xyz="([^"]+)"', lambda m: f'xyz="{" ".join(f"{length * float(x):g}" for x in m[1].split())}"', text)
    text = re.sub(r'mass value="([^"]+)"', lambda m: f'mass value="{mass * float(m[1]):g}"', text)
    return re.sub(r'(i[xyz]{2})="([^"]+)"', lambda m: f'{m[1]}="{inertia * float(m[2]):g}"', text)


def faults(folder: Path, text: str) -> list[str]:
    """What is said of a file."""
    file = folder / "robot.urdf"
    file.write_text(text)
    return [f"{fault.what} ({fault.why}): {fault.mend}" for fault in wrong_units(load_robot(file))]


@pytest.mark.parametrize("name", ["arm3", "planar2", "pendulum"])
@pytest.mark.parametrize(
    "units",
    [
        {"length": 1e3},
        {"length": 1e3, "mass": 1e3},
        {"inertia": 1e6},
        {"inertia": 1e9},
    ],
    ids=["mm and kg", "mm and g", "inertias in kg mm^2", "inertias in g mm^2"],
)
def test_a_model_in_millimetres(tmp_path, name, units):
    (told,) = faults(tmp_path, in_units((ROBOTS / f"{name}.urdf").read_text(), **units))
    assert "the lengths or inertias of robot.urdf are in mm and not in m (" in told
    assert "correct robot.urdf: lengths in m, masses in kg and inertias in kg m^2" in told


def test_what_was_seen_is_said_with_its_place(tmp_path):
    (told,) = faults(tmp_path, in_units((ROBOTS / "pendulum.urdf").read_text(), length=1e3))
    assert (
        "the centre of mass of rod lies 500 m from its joint on a robot of 2 kg in all, which would be thinner" in told
    )


@pytest.mark.parametrize("mass", ["5e-324", "1e-15"])
def test_what_is_no_length_in_mm_either_is_not_called_so(tmp_path, mass):
    # The first quotient of inertia and mass is beyond all numbers.
    text = (ROBOTS / "pendulum.urdf").read_text()
    (told,) = faults(tmp_path, re.sub(r'<mass value="[^"]*"', f'<mass value="{mass}"', text))
    assert told.startswith("a length, mass or inertia of robot.urdf is that of no robot (the inertia of rod is that of")
    assert "inf" not in told
    assert "mm" not in told


def test_a_model_in_grams(tmp_path):
    (told,) = faults(tmp_path, in_units((ROBOTS / "arm3.urdf").read_text(), mass=1e3))
    assert told.startswith(
        "the masses of robot.urdf are in g and not in kg (column has 3000 kg and an inertia that only"
    )


def test_the_density_is_that_of_a_ball(tmp_path):
    # Closed form: a ball of 3000 kg and 0.1 m has 2/5 m r^2 = 12 kg m^2 and 3000 / (4/3 pi 0.001) = 7.2e5 kg/m^3.
    (told,) = faults(tmp_path, BODY.format(at=0.1, mass=3000, i=12))
    assert "a body of 7.2e+05 kg/m^3 or more" in told


@pytest.mark.parametrize(
    ("what", "at", "mass", "inertia"),
    [
        ("a point mass", 0.3, 500.0, 0.0),
        ("an inertia that was never filled in", 0.3, 200.0, 0.001),
        ("a block of steel", 0.2, 1e4, 1e4 * 0.4 * 0.67**2),
        ("a grain", 1e-3, 1e-6, 1e-6 * 1e-3**2),
        ("a grain on a long thread", 0.5, 1e-6, 1e-12),
        ("a crane's boom", 40.0, 4e4, 4e4 * 25.0**2),
        ("an arm of a space station", 9.0, 400.0, 400 * 5.0**2),
    ],
)
def test_what_exists_is_not_blamed(tmp_path, what, at, mass, inertia):
    assert faults(tmp_path, BODY.format(at=at, mass=mass, i=inertia)) == [], what


@pytest.mark.parametrize(
    "file",
    [
        *builtin_robots().values(),
        *sorted(ROBOTS.glob("*.urdf")),
        *sorted(ROBOTS.glob("*.xml")),
        *sorted((CHECKOUT / "examples").rglob("*.urdf")),
    ],
    ids=lambda file: f"{file.parent.name}/{file.name}",
)
def test_the_robots_that_are_shipped_are_right(file):
    assert wrong_units(load_robot(file)) == ()


def test_a_recording_of_a_model_in_millimetres_is_certainly_wrong(clean, arm, tmp_path):
    (tmp_path / "robot.urdf").write_text(in_units((ROBOTS / "arm3.urdf").read_text(), length=1e3))
    (fault,) = checked(clean(), load_robot(tmp_path / "robot.urdf")).wrong
    assert "in mm and not in m" in fault.what


def test_torques_that_are_a_thousandth_may_also_come_of_masses_in_grams(clean, arm, changed):
    recording = clean()
    (fault,) = checked(changed(recording, tau=recording.tau / 1e3), arm).wrong
    assert fault.what == "the torques are in kNm and not in N m, or the masses of the model in g and not in kg"


def test_a_slide_in_millimetres(clean, arm, changed):
    recording = clean()
    (fault,) = checked(changed(recording, q=recording.q * [1, 1, 1e3]), arm).wrong
    assert fault.what == "the positions of slide are in mm and not in m"
    assert "write q.slide: {from: q.slide, unit: mm} into a column map" in fault.mend


def axis(times: float) -> tuple[Recording, object]:
    """A recording of the one slide of EMPS: a swing of 0.2 m in 2 s, its positions times a number."""
    robot = load_robot("emps")
    t = np.arange(4000) / 200
    w = np.pi
    motion = Motion(
        t, *(x[:, None] for x in (0.2 * np.sin(w * t), 0.2 * w * np.cos(w * t), -0.2 * w**2 * np.sin(w * t)))
    )
    tau = inverse_dynamics(robot, motion)
    return Recording("axis.csv", robot.joint_names, t, times * motion.q, tau), robot


def test_a_lone_axis_in_millimetres_is_too_fast_for_any_machine():
    # On one axis alone, inertia and friction could be anything: 0.4 m of travel at 628 m/s could not.
    (fault,) = checked(*axis(1e3)).wrong
    assert fault.what == "the positions of axis are in mm and not in m"
    speed = float(re.fullmatch(r"as it stands a joint moves at up to (\d+) m/s", fault.why)[1])
    assert speed == pytest.approx(628, rel=0.02)


def test_a_lone_axis_in_metres_is_right():
    assert checked(*axis(1.0)).wrong == ()


@pytest.fixture(scope="module")
def arm3():
    return load_robot(ROBOTS / "arm3.urdf")


def moved(recording, joint, shift):
    way = np.zeros(recording.q.shape[1])
    way[joint] = shift
    return replace(recording, q=recording.q + way)


@pytest.mark.parametrize("shift", [11.0, -11.0])
def test_a_joint_more_than_a_turn_outside_its_range_is_wrong_without_any_torque(clean, arm3, shift):
    recording = replace(moved(clean(robot=arm3), 1, shift), tau=None)
    (fault,) = checked(recording, arm3).wrong
    assert f"positions of {arm3.joint_names[1]} are where it cannot be" in fault.what
    assert "more than a turn outside" in fault.why


def test_degrees_that_are_inside_when_converted_get_their_entry(clean, arm3):
    recording = clean(robot=arm3)
    degrees = replace(recording, q=recording.q * [1.0, 180 / np.pi, 1.0], tau=None)
    name = arm3.joint_names[1]
    assert f"q.{name}: {{from: q.{name}, unit: deg}}" in checked(degrees, arm3).wrong[0].mend


@pytest.mark.parametrize("turns", [-2, 1, 3])
def test_an_encoder_that_counts_turns_is_not_wrong(clean, arm3, turns):
    assert beyond_range(moved(clean(robot=arm3), 1, 2 * np.pi * turns), arm3) == ()


@pytest.mark.parametrize("shift", [0.0, 3.0])
def test_a_joint_less_than_a_turn_outside_is_left_to_other_checks(clean, arm3, shift):
    assert beyond_range(moved(clean(robot=arm3), 1, shift), arm3) == ()


def test_a_joint_without_a_range_may_turn_many_times(clean):
    robot = load_robot("example:ur5")
    free = replace(robot, model=robot.model)
    free.model.lowerPositionLimit[:], free.model.upperPositionLimit[:] = -np.inf, np.inf
    assert beyond_range(moved(clean(robot=free), 0, 40.0), free) == ()


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
    assert check_recording(swings(arm, np.arange(int(seconds * rate)) / rate, slowest_hz), arm) == ()


def test_a_motion_that_is_sampled_too_slowly_is_told_and_is_no_standstill(arm):
    # Sines of 0.4 Hz and more, sampled once a second: the positions are those of noise.
    said = check_recording(swings(arm, np.arange(300.0), 0.4), arm)
    assert not [sentence for sentence in said if "never moves" in sentence or "no joint moves" in sentence]
    (one,) = [sentence for sentence in said if "jump about" in sentence]
    assert one.startswith("log.csv: the positions of turn, tilt, slide jump about from sample to sample")
    assert one.endswith("record with far more than 1 Hz, or move more slowly.")


def test_a_joint_that_rests_with_a_noisy_encoder_never_moves(arm, changed):
    recording = swings(arm, np.arange(4000) / 200, 0.5)
    resting = recording.q.copy()
    resting[:, 0] = 0.3 + 2e-3 * np.random.default_rng(1).standard_normal(4000)
    said = check_recording(changed(recording, q=resting), arm)
    assert any("turn never moves" in sentence for sentence in said)
