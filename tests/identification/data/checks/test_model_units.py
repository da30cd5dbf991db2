"""Models in wrong units, and recordings in units that do not fit the model."""

import re
from pathlib import Path

import numpy as np
import pytest

from identification.data.checks.check_recording import checked
from identification.data.checks.model_units import wrong_units
from identification.data.recording import Recording
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.model.loading import load_robot
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
