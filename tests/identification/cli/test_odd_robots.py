"""Robots of odd sizes and kinds through the commands. Oracle: known truth (Coulomb friction that the model lacks)."""

import json

import numpy as np
import pytest

from by_night import by_night
from identification.cli.main import main
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.model.loading import load_robot
from sines import columns_of, sines

pytestmark = pytest.mark.whole

AXES = ("0 1 0", "1 0 0", "0 0 1")
LINK = """<link name="l{k}"><inertial><origin xyz="{at} 0 -{at}"/><mass value="{mass}"/>
<inertia ixx="{i}" iyy="{i}" izz="{i}" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
JOINT = """<joint name="j{k}" type="{kind}"><parent link="l{parent}"/><child link="l{k}"/><origin xyz="{at} 0 0"/>
<axis xyz="{axis}"/><limit lower="-9" upper="9" effort="99" velocity="9"/></joint>"""


def chain(joints: int, *, length: float = 0.3, mass: float = 1.0, kind: str = "revolute", massless: int = 0) -> str:
    """A chain of equal links about changing axes, one of them perhaps without mass."""
    parts = ['<robot name="chain"><link name="l0"/>']
    for k in range(1, joints + 1):
        inertia = 0.2 * mass * length**2
        parts.append(f'<link name="l{k}"/>' if k == massless else LINK.format(k=k, at=length / 3, mass=mass, i=inertia))
        at = length if k > 1 else 0.0
        parts.append(JOINT.format(k=k, parent=k - 1, kind=kind, at=at, axis=AXES[(k - 1) % 3]))
    return "".join(parts) + "</robot>"


def recorded(file, written, *, seconds: float = 10.0, rate: float = 200.0, friction: float = 0.2):
    """A log beside a robot file: sines, with friction as a share of each joint's torque and noise of 1 % of it."""
    robot, rng = load_robot(file), np.random.default_rng(3)
    motion = sines(np.arange(int(seconds * rate)) / rate, robot.nv, rng, count=4, size=0.15)
    tau = inverse_dynamics(robot, motion)
    size = tau.std(axis=0)
    tau += friction * size * np.sign(motion.v) + 0.01 * size * rng.standard_normal(tau.shape)
    columns = columns_of(motion.t, robot.joint_names, motion.q, tau)
    return columns, size, written(file.with_name("log.csv"), columns)


@pytest.fixture
def robot_file(tmp_path):
    """Writes a robot and returns its file."""

    def write(text: str):
        (tmp_path / "robot.urdf").write_text(text)
        return tmp_path / "robot.urdf"

    return write


@pytest.fixture
def checked(capsys):
    """What check says of a robot and a log."""

    def run(robot, log) -> str:
        assert main(["check", str(robot), str(log)]) == 0
        return capsys.readouterr().out

    return run


def diagnosed(robot, log, *words: str) -> dict:
    """What a diagnosis finds."""
    file = log.with_name("found.json")
    assert main(["diagnose", str(robot), str(log), "--json", str(file), *words]) == 0
    return json.loads(file.read_text())


@pytest.mark.parametrize("mass", [1e-6, 1e4])
def test_bodies_from_a_milligram_to_ten_tons(robot_file, written, mass):
    # Length goes with the cube root of mass, as of bodies of one density.
    file = robot_file(chain(2, mass=mass, length=0.3 * np.cbrt(mass)))
    _, size, log = recorded(file, written)
    found = diagnosed(file, log)["findings"]
    assert {(f["effect"], f["joint"]) for f in found} == {("coulomb_friction", "j1"), ("coulomb_friction", "j2")}
    for f in found:
        truth = 0.2 * size[int(f["joint"][1]) - 1]
        assert f["parameters"]["torque"]["value"] == pytest.approx(truth, rel=0.03)


@pytest.mark.parametrize("joints", by_night([1, 12, 50], 0, 1))
def test_one_to_fifty_joints(robot_file, written, checked, joints):
    file = robot_file(chain(joints, length=0.1))
    _, _, log = recorded(file, written, rate=50.0, seconds=8.0)
    assert checked(file, log).endswith("nothing is wrong with it\n")


@pytest.mark.parametrize(("kind", "massless"), [("revolute", 2), ("prismatic", 0), ("continuous", 3)])
def test_every_kind_of_joint_and_links_without_mass(robot_file, written, checked, kind, massless):
    file = robot_file(chain(3, kind=kind, massless=massless))
    _, _, log = recorded(file, written, seconds=5.0)
    assert "wrong" not in checked(file, log).replace("nothing is wrong", "")


def test_gaps_leave_pieces_that_are_used(robot_file, written, capsys):
    # Of a second and of two seconds of swings nothing is recorded: no bridge over them could be right.
    file = robot_file(chain(1))
    columns, size, log = recorded(file, written, seconds=20.0)
    t = columns["t"]
    kept = (t < 5) | ((t > 6) & (t < 12)) | (t > 14)
    log = written(log, {name: values[kept] for name, values in columns.items()})
    found = diagnosed(file, log)
    assert any("2 gaps in time" in sentence for sentence in found["data_warnings"])
    (only,) = found["findings"]
    torque = only["parameters"]["torque"]
    assert abs(torque["value"] - 0.2 * size[0]) < 4 * torque["std"]
