"""Strange but legal recordings and robots: the job is done, the JSON keeps the contract, no warning reaches the user.

Oracle: the contract's schema, and known truth (0.4 more Coulomb friction than modelled on every joint) where it shows.
"""

import json
import warnings

import numpy as np
import pytest

from by_night import by_night
from identification.cli.main import main
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.model.loading import load_robot
from phantom_dyn.motion import Motion

pytestmark = pytest.mark.whole

COULOMB = [("coulomb_friction", "pin")]
TWO_LINKS = """<robot name="two"><link name="l0"/>{links}
<joint name="a" type="{kinds[0]}"><parent link="l0"/><child link="l1"/><axis xyz="0 1 0"/>
  <limit lower="-9" upper="9" effort="99" velocity="9"/></joint>
<joint name="b" type="{kinds[1]}"><parent link="l1"/><child link="l2"/><origin xyz="0.3 0 0"/><axis xyz="0 1 0"/>
  <limit lower="-9" upper="9" effort="99" velocity="9"/></joint></robot>"""
LINK = """<link name="{name}"><inertial><origin xyz="0.1 0 -0.1"/><mass value="{mass}"/>
<inertia ixx="{i}" iyy="{i}" izz="{i}" ixy="0" ixz="0" iyz="0"/></inertial></link>"""


def two_links(kinds=("revolute", "revolute"), last_mass: float = 1.0) -> str:
    """A robot of two joints without friction; a mass of zero is a link without inertia."""
    masses = {"l1": 2.0, "l2": last_mass}
    links = [LINK.format(name=n, mass=m, i=0.02 * m) if m else f'<link name="{n}"/>' for n, m in masses.items()]
    return TWO_LINKS.format(links="".join(links), kinds=kinds)


@pytest.fixture
def content(tmp_path, capsys, document):
    """Runs diagnose; asserts what holds for every legal recording, and returns what the JSON holds."""

    def run(*words: object) -> dict:
        file = tmp_path / "diagnosed.json"
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            assert main(["diagnose", *map(str, words), "--json", str(file)]) == 0
        assert capsys.readouterr().err == ""
        document(file.read_bytes())
        return json.loads(file.read_text())

    return run


def causes(content: dict) -> list[tuple[str, str]]:
    return [(found["effect"], found["joint"]) for found in content["findings"]]


def moved(robot_file, motion: Motion, friction: float = 0.4, noise: float = 0.01) -> dict:
    """Columns of a recording of a given motion."""
    robot = load_robot(robot_file)
    tau = inverse_dynamics(robot, motion) + friction * np.sign(motion.v)
    tau += noise * np.random.default_rng(1).standard_normal(tau.shape)
    positions = {f"q.{joint}": motion.q[:, k] for k, joint in enumerate(robot.joint_names)}
    return {"t": motion.t, **positions, **{f"tau.{joint}": tau[:, k] for k, joint in enumerate(robot.joint_names)}}


def swinging(t: np.ndarray, drift: float = 0.0) -> Motion:
    """One joint: two sines about a steady turn [rad/s]."""
    w = 2 * np.pi * np.array([0.31, 0.83])
    q = 0.4 * np.sin(np.outer(t, w)).sum(axis=1) + drift * t
    v = 0.4 * (w * np.cos(np.outer(t, w))).sum(axis=1) + drift
    a = -0.4 * (w**2 * np.sin(np.outer(t, w))).sum(axis=1)
    return Motion(t, q[:, None], v[:, None], a[:, None])


@pytest.mark.parametrize("rate", by_night([100.0, 10_000.0], 1))
def test_every_rate(tmp_path, pendulum, made_columns, written, content, rate):
    log = written(tmp_path / "log.csv", made_columns(pendulum, rate=rate, seconds=5.0))
    assert causes(content(pendulum, log)) == COULOMB


@pytest.mark.parametrize("start", by_night([-50.0, 1.7e9], 1))
def test_time_may_begin_anywhere(tmp_path, pendulum, swing, written, content, start):
    log = written(tmp_path / "log.csv", swing | {"t": swing["t"] + start})
    assert causes(content(pendulum, log)) == COULOMB


def test_jittered_time_stamps(tmp_path, pendulum, written, content, rng):
    t = np.arange(2000) / 200 + rng.uniform(-1e-3, 1e-3, 2000)
    log = written(tmp_path / "log.csv", moved(pendulum, swinging(t)))
    assert causes(content(pendulum, log)) == COULOMB


def test_no_noise_and_no_gap(tmp_path, pendulum, written, content):
    log = written(tmp_path / "log.csv", moved(pendulum, swinging(np.arange(2000) / 200), friction=0.0, noise=0.0))
    assert content(pendulum, log)["verdict"] == "no_gap"


def test_motion_in_one_direction(tmp_path, pendulum, written, content):
    motion = swinging(np.arange(4000) / 200, drift=4.0)
    assert motion.v.min() > 0
    # It leaves the range that its URDF states by turns, which is refused without the word.
    found = content(pendulum, written(tmp_path / "log.csv", moved(pendulum, motion)), "--anyway")["findings"]
    # Forward only, Coulomb friction and an offset are the same: both have to be named.
    named = {(f["effect"], *(e["effect"] for r in f["rivals"] for e in r["effects"])) for f in found}
    assert any({"coulomb_friction", "torque_offset"} <= set(names) for names in named)


@pytest.mark.parametrize(
    "config",
    by_night(
        [
            "tolerance: {inertia: 0, friction: 0, rotor_inertia: 0}",
            "tolerance: {inertia: 0.1, friction: 0.1, rotor_inertia: 1}",
            "torque_source: sensor",
            "torque_source: current",
            "joints: {pin: {encoder_counts: 4096}}",
            "joints: {pin: {rotor_inertia: 1.0e-9}}",
        ],
        0,
        4,
    ),
)
def test_every_configuration(tmp_path, pendulum, log, content, config):
    (tmp_path / "robot.yaml").write_text(config)
    assert causes(content(pendulum, log, "--robot-config", tmp_path / "robot.yaml")) == COULOMB


@pytest.mark.parametrize(
    "config", by_night(["gravity: [0, 0, 0]", "joints: {pin: {rotor_inertia: 1.0e+4}}", "torque_hold: zoh"], 1)
)
def test_a_configuration_that_is_far_off(tmp_path, pendulum, log, content, config):
    (tmp_path / "robot.yaml").write_text(config)
    assert content(pendulum, log, "--robot-config", tmp_path / "robot.yaml")["joints"][0]["rms_before"] > 0.1


@pytest.mark.parametrize(
    "kinds",
    by_night([(("continuous", "continuous"),), (("prismatic", "revolute"),), (("revolute", "prismatic"),)], 1),
)
def test_every_kind_of_joint(tmp_path, made_columns, written, content, kinds):
    (tmp_path / "robot.urdf").write_text(two_links(kinds))
    log = written(tmp_path / "log.csv", made_columns(tmp_path / "robot.urdf"))
    found = content(tmp_path / "robot.urdf", log)
    assert {joint for _, joint in causes(found)} == {"a", "b"}
    assert [joint["unit"] for joint in found["joints"]] == ["N" if kind == "prismatic" else "N m" for kind in kinds]


def test_a_link_without_mass(tmp_path, made_columns, written, content):
    (tmp_path / "robot.urdf").write_text(two_links(last_mass=0.0))
    log = written(tmp_path / "log.csv", made_columns(tmp_path / "robot.urdf"))
    assert ("coulomb_friction", "b") in causes(content(tmp_path / "robot.urdf", log))


def test_many_turns_of_a_continuous_joint(tmp_path, pendulum, written, content):
    (tmp_path / "robot.urdf").write_text(pendulum.read_text().replace('"revolute"', '"continuous"'))
    t = np.arange(4000) / 200
    q, w = 30 * np.sin(0.6 * t), 0.6
    motion = Motion(t, q[:, None], (30 * w * np.cos(w * t))[:, None], (-(w**2) * q)[:, None])
    found = content(tmp_path / "robot.urdf", written(tmp_path / "log.csv", moved(tmp_path / "robot.urdf", motion)))
    assert causes(found) == COULOMB


def test_a_joint_that_rests_without_torque(tmp_path, arm, written, content):
    # Only the slide moves: the turntable needs no torque for that, so neither motion nor noise is seen there.
    one = swinging(np.arange(2000) / 200)
    q, v, a = (x * np.array([0.0, 0.0, 1.0]) for x in (one.q, one.v, one.a))
    found = content(arm, written(tmp_path / "log.csv", moved(arm, Motion(one.t, q, v, a))))
    assert "turn" not in {joint for _, joint in causes(found)}


@pytest.mark.parametrize("factor", by_night([1e-9, 1e7], 0))
def test_torques_of_another_size(tmp_path, pendulum, swing, written, content, factor):
    found = content(pendulum, written(tmp_path / "log.csv", swing | {"tau.pin": factor * swing["tau.pin"]}))
    assert all(f["gap_closed"] > 0 for f in found["findings"])
    assert not (found["verdict"] == "explained" and found["joints"][0]["rms_after"] > found["joints"][0]["rms_before"])
