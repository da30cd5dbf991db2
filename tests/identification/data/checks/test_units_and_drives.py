"""Checks of units, ranges and drives against the model."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from identification.data.checks.beyond_range import beyond_range
from identification.data.checks.certain_faults import massless_model
from identification.data.checks.check_recording import checked
from identification.data.checks.drive_loops import check_computed, check_controllers, loop_sentences
from identification.data.checks.model_units import wrong_units
from identification.data.checks.positions import check_passive
from identification.data.reading import recording
from identification.data.recording import Recording, Table
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.errors import LogError
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Controller, Robot
from phantom_dyn.model.robot_files import builtin_robots
from phantom_dyn.motion import Motion
from places import CHECKOUT, ROBOTS

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
    (said,) = faults(tmp_path, in_units((ROBOTS / f"{name}.urdf").read_text(), **units))
    assert "the lengths or inertias of robot.urdf are in mm and not in m (" in said
    assert "correct robot.urdf: lengths in m, masses in kg and inertias in kg m^2" in said


def test_what_was_seen_is_said_with_its_place(tmp_path):
    (said,) = faults(tmp_path, in_units((ROBOTS / "pendulum.urdf").read_text(), length=1e3))
    assert (
        "the centre of mass of rod lies 500 m from its joint on a robot of 2 kg in all, which would be thinner" in said
    )


@pytest.mark.parametrize("mass", ["5e-324", "1e-15"])
def test_what_is_no_length_in_mm_either_is_not_called_so(tmp_path, mass):
    # The first quotient of inertia and mass is beyond all numbers.
    text = (ROBOTS / "pendulum.urdf").read_text()
    (said,) = faults(tmp_path, re.sub(r'<mass value="[^"]*"', f'<mass value="{mass}"', text))
    assert said.startswith("a length, mass or inertia of robot.urdf is that of no robot (the inertia of rod is that of")
    assert "inf" not in said
    assert "mm" not in said


def test_a_model_in_grams(tmp_path):
    (said,) = faults(tmp_path, in_units((ROBOTS / "arm3.urdf").read_text(), mass=1e3))
    assert said.startswith(
        "the masses of robot.urdf are in g and not in kg (column has 3000 kg and an inertia that only"
    )


def test_the_density_is_that_of_a_ball(tmp_path):
    # Closed form: a ball of 3000 kg and 0.1 m has 2/5 m r^2 = 12 kg m^2 and 3000 / (4/3 pi 0.001) = 7.2e5 kg/m^3.
    (said,) = faults(tmp_path, BODY.format(at=0.1, mass=3000, i=12))
    assert "a body of 7.2e+05 kg/m^3 or more" in said


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


def test_torques_that_are_a_thousandth_may_also_come_of_masses_in_grams(arm, changed, recording):
    (fault,) = checked(changed(recording, tau=recording.tau / 1e3), arm).wrong
    assert fault.what == "the torques are in kNm and not in N m, or the masses of the model in g and not in kg"


def test_a_slide_in_millimetres(arm, changed, recording):
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
    speed = float(re.fullmatch(r"as recorded a joint moves at up to (\d+) m/s", fault.why)[1])
    assert speed == pytest.approx(628, rel=0.02)


def test_a_lone_axis_in_metres_is_right():
    assert checked(*axis(1.0)).wrong == ()


def moved(recording, joint, shift):
    way = np.zeros(recording.q.shape[1])
    way[joint] = shift
    return replace(recording, q=recording.q + way)


@pytest.mark.parametrize("shift", [11.0, -11.0])
def test_a_joint_more_than_a_turn_outside_its_range_is_wrong_without_any_torque(clean, arm, shift):
    recording = replace(moved(clean(robot=arm), 1, shift), tau=None)
    (fault,) = checked(recording, arm).wrong
    assert f"positions of {arm.joint_names[1]} are where it cannot be" in fault.what
    assert "more than a turn outside" in fault.why


def test_degrees_that_are_inside_when_converted_get_their_entry(clean, arm):
    recording = clean(robot=arm)
    degrees = replace(recording, q=recording.q * [1.0, 180 / np.pi, 1.0], tau=None)
    name = arm.joint_names[1]
    assert f"q.{name}: {{from: q.{name}, unit: deg}}" in checked(degrees, arm).wrong[0].mend


@pytest.mark.parametrize("turns", [-2, 1, 3])
def test_an_encoder_that_counts_turns_is_not_wrong(clean, arm, turns):
    assert beyond_range(moved(clean(robot=arm), 1, 2 * np.pi * turns), arm) == ()


@pytest.mark.parametrize("shift", [0.0, 3.0])
def test_a_joint_less_than_a_turn_outside_is_left_to_other_checks(clean, arm, shift):
    assert beyond_range(moved(clean(robot=arm), 1, shift), arm) == ()


def test_a_joint_without_a_range_may_turn_many_times(clean):
    robot = load_robot("example:ur5")
    free = replace(robot, model=robot.model)
    free.model.lowerPositionLimit[:], free.model.upperPositionLimit[:] = -np.inf, np.inf
    assert beyond_range(moved(clean(robot=free), 0, 40.0), free) == ()


T = np.arange(2000) / 100.0

Q_REF = 0.6 * np.sin(1.9 * T) + 0.3 * np.sin(4.1 * T)

Q = 0.9 * (0.6 * np.sin(1.9 * (T - 0.1)) + 0.3 * np.sin(4.1 * (T - 0.1)))


def late(delay: float) -> np.ndarray:
    return 0.6 * np.sin(1.9 * (T - delay)) + 0.3 * np.sin(4.1 * (T - delay))


@pytest.fixture(scope="module")
def robot() -> Robot:
    """A rod on a motor of 0.5 N m/V."""
    found = load_robot(ROBOTS / "pendulum.urdf")
    drive = replace(found.actuators[0], torque_constant=1.0, resistance=2.0, controller=Controller(kp=12.0))
    return replace(found, actuators=(drive,))


def read(robot: Robot, **columns: np.ndarray) -> Recording:
    return recording(Table("a.csv", {"t": T, "q.pin": Q, "q_ref.pin": Q_REF, **columns}), robot)


def test_a_voltage_that_was_computed_is_said_to_be(robot):
    found = read(robot, **{"u.pin": 24.0 * (Q_REF - Q)})
    assert "it was computed, not measured" not in check_controllers(found, robot)
    assert "u.pin was computed from reference and position" in check_computed(found)[0]
    assert "gain 24" in loop_sentences(found)[0]


def test_a_voltage_that_was_measured_has_its_delay(robot, rng):
    found = read(robot, **{"u.pin": 24.0 * (late(0.03) - Q) + 0.1 * rng.standard_normal(len(T))})
    assert check_computed(found) == ()
    stated = re.search(r"its reference ([\d.]+) ± ([\d.]+) ms late", loop_sentences(found)[0])
    assert stated is not None
    assert float(stated[1]) == pytest.approx(30.0, abs=3 * float(stated[2]))


def test_a_held_reference_is_late_by_a_time_within_a_frame(robot, rng):
    held = replace(robot, reference_hold="zoh")
    found = read(held, **{"u.pin": 24.0 * (late(0.03) - Q) + 0.01 * rng.standard_normal(len(T))})
    stated = re.search(r"its reference ([\d.]+) to ([\d.]+) ± [\d.]+ ms late", loop_sentences(found)[0])
    assert stated is not None
    assert [float(x) for x in stated.groups()] == pytest.approx([20.0, 30.0], abs=1.5)


def test_protection_is_said_with_its_error(robot):
    error = late(0.03) - Q
    found = read(robot, **{"u.pin": np.where(np.abs(error) > 0.15, 0.8 * np.sign(error), 24.0 * error)})
    assert re.search(r"no more than 0\.8 V beyond an error of 0\.15, for \d+ % of the time", loop_sentences(found)[0])


def test_a_torque_that_follows_a_law_makes_no_late_reference(robot):
    # Whoever commands a torque knows the reference at that instant.
    assert read(robot, **{"tau.pin": 12.0 * (Q_REF - Q)}).reference_gain is None


def test_a_controller_that_gives_the_logged_torque_is_not_doubted(robot):
    assert check_controllers(read(robot, **{"tau.pin": 12.0 * (late(0.03) - Q)}), robot) == ()


@pytest.mark.parametrize("factor", [0.4, 2.5])
def test_gains_that_do_not_give_the_logged_torque_are_named(robot, factor):
    (sentence,) = check_controllers(read(robot, **{"tau.pin": factor * 12.0 * (Q_REF - Q)}), robot)
    assert f"{factor:.3g} times what it asks for explains 100 %" in sentence


def test_a_torque_that_no_controller_makes_is_named(robot, rng):
    (sentence,) = check_controllers(read(robot, **{"tau.pin": np.sin(9 * T) + rng.standard_normal(len(T))}), robot)
    assert "does not give its logged torque" in sentence


SECONDS = np.arange(100) * 0.01

CRANK = np.sin(SECONDS)


@pytest.fixture
def parallelogram(tmp_path) -> Robot:
    config = tmp_path / "chain.yaml"
    config.write_text("loops: [{kind: linear, active: [crank], passive: {coupler: -crank, rocker: crank}}]")
    return load_robot(ROBOTS / "parallelogram.urdf", config=config)


def logged(robot: Robot, **columns: np.ndarray) -> Recording:
    given = {"t": SECONDS, "q.crank": CRANK, "tau.crank": np.cos(SECONDS)}
    return recording(Table("log.csv", given | {name.replace("__", "."): c for name, c in columns.items()}), robot)


def test_a_log_holds_the_active_joints(parallelogram):
    found = logged(parallelogram)
    assert (found.joint_names, found.q.shape, dict(found.passive_q)) == (("crank",), (100, 1), {})


def test_positions_of_passive_joints_are_kept(parallelogram):
    np.testing.assert_array_equal(logged(parallelogram, q__coupler=-CRANK).passive_q["coupler"], -CRANK)


def test_passive_joints_where_the_loops_put_them_are_no_warning(parallelogram):
    found = logged(parallelogram, q__coupler=-CRANK, q__rocker=CRANK + 2 * np.pi)
    assert check_passive(found, parallelogram) == ()


def test_a_passive_joint_elsewhere_is_reported_with_its_distance(parallelogram):
    (sentence,) = check_passive(logged(parallelogram, q__rocker=CRANK + 0.1), parallelogram)
    assert sentence.startswith("log.csv: the measured position of rocker is 0.1 rad (rms) from where the loops of")


def test_torque_of_a_passive_joint_is_reported_and_not_used(parallelogram):
    found = logged(parallelogram, tau__rocker=np.ones(100))
    assert "log.csv: the torque of rocker is not used, as the joint is passive: it has no drive." in found.warnings


def test_zero_torque_of_a_passive_joint_is_no_warning(parallelogram):
    assert logged(parallelogram, tau__rocker=np.zeros(100)).warnings == ()


def test_a_column_of_an_unknown_joint_lists_the_passive_ones_too(parallelogram):
    with pytest.raises(LogError, match=r"q\.rock is of the joint rock, .*: the joints are crank, coupler, rocker; did"):
        logged(parallelogram, q__rock=CRANK)


def test_a_log_beyond_the_reach_of_the_loops_is_refused(tmp_path):
    config = tmp_path / "chain.yaml"
    loop = "kind: point, frame_a: coupler_pin, frame_b: rocker_pin, active: [rocker], start: {crank: 0.1}"
    config.write_text(f"loops: [{{{loop}}}]")
    robot = load_robot(ROBOTS / "fourbar.urdf", config=config)
    q = np.linspace(-0.2, 1.5, 100)
    log = recording(Table("log.csv", {"t": SECONDS, "q.rocker": q, "tau.rocker": np.cos(SECONDS)}), robot)
    with pytest.raises(LogError, match=r"^log\.csv: The loop loops\[0\] .* cannot be closed at sample \d+: its frames"):
        check_passive(log, robot)


def with_rotors_alone(name: str) -> Robot:
    """A robot whose links have no mass, and whose rotors have inertia."""
    out = load_robot(ROBOTS / f"{name}.urdf")
    for k in range(1, out.model.njoints):
        out.model.inertias[k] = pin.Inertia.Zero()
    out.model.armature = np.full(out.nv, 0.01)
    return out


@pytest.mark.parametrize(("name", "faults"), [("planar2", 1), ("pendulum", 0)])
def test_links_without_mass_are_a_fault_unless_a_motor_stands_alone(name, faults):
    assert len(massless_model(with_rotors_alone(name))) == faults
