# pyright: reportAttributeAccessIssue=false
"""Cases of robots on bases that move. Oracles: MuJoCo's mass matrix, Pinocchio's sum of bodies, and the log itself."""

from dataclasses import replace

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from benchmarks.legged.cases import CAUSES, Plant, write_case, write_trot
from benchmarks.legged.files import plant, urdf
from benchmarks.legged.motions import Task
from benchmarks.legged.robots import arm, biped, quadruped
from benchmarks.legged.simulate import Drive, Ground, Sensor, read_by, simulate
from benchmarks.legged.visible import gap_over_floor
from phantom_dyn.dynamics.dynamics import mass_matrix
from phantom_dyn.model.loading import load_robot

PERFECT = Sensor(np.zeros((2, 3)), np.ones((2, 3)), np.zeros(3), np.zeros(3), 0.0)
HANGS = Task(True, 2.0, 500.0, 1.0, 0.5, 0.16, 0.0, 0.4)


def sound(count: int) -> Drive:
    return Drive(np.ones(count), np.zeros(count))


@pytest.mark.parametrize("kind", [quadruped, biped, arm])
def test_the_simulated_robot_is_the_one_of_the_file(kind, tmp_path, rng):
    own = kind()
    count = len(own.parts)
    (tmp_path / "robot.urdf").write_text(urdf(own))
    robot = load_robot(tmp_path / "robot.urdf")
    model = mujoco.MjModel.from_xml_string(plant(own, own.numbers, 0.001))
    data = mujoco.MjData(model)
    q = rng.normal(size=count)
    data.qpos[7:] = q
    mujoco.mj_forward(model, data)
    full = np.empty((count + 6, count + 6))
    mujoco.mj_fullM(model, data, full)
    of_joints = {mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, k): k + 5 for k in range(1, count + 1)}
    order = np.array([of_joints[name] for name in robot.joint_names])
    places = [own.joints.index(name) for name in robot.joint_names]
    expected = full[np.ix_(order, order)] - np.diag(own.numbers.armature[places])
    np.testing.assert_allclose(mass_matrix(robot, q[None, order - 6])[0], expected, atol=1e-9)


def test_a_payload_is_the_link_with_a_point_mass():
    own = quadruped()
    before, j = own.numbers, own.joints.index("RL_calf_joint")
    after = CAUSES["payload"](Plant(own, before, sound(12)), j, 2.0).numbers

    def body(numbers):
        return pin.Inertia(float(numbers.mass[j]), numbers.center[j], np.diag(numbers.mass[j] * numbers.radius[j] ** 2))

    added = body(after).toDynamicParameters() - body(before).toDynamicParameters()
    point = pin.Inertia(0.3, 1.3 * before.center[j], np.zeros((3, 3))).toDynamicParameters()
    # Products of inertia of the sum are left out, as the file has none: they are below a thousandth of its moments.
    np.testing.assert_allclose(added[[0, 1, 2, 3, 4, 6, 9]], point[[0, 1, 2, 3, 4, 6, 9]], atol=2e-5)


def test_a_weak_drive_lets_the_robot_lag_behind_its_references():
    own = quadruped()
    lags = []
    for drive in (sound(12), Drive(np.full(12, 0.2), np.zeros(12))):
        log = simulate(own, own.numbers, drive, PERFECT, Ground(), HANGS, np.random.default_rng(3)).log
        lags.append(np.mean([np.std(log[f"q_ref.{joint}"] - log[f"q.{joint}"]) for joint in own.joints]))
    assert lags[1] > 1.2 * lags[0]


def test_a_sensor_without_errors_reads_what_there_is(rng):
    there = rng.normal(size=(50, 6))
    np.testing.assert_allclose(read_by(PERFECT, there, 500.0), there, atol=1e-12)


def test_a_case_that_is_there_is_kept(tmp_path):
    folder = tmp_path / "null000"
    folder.mkdir()
    (folder / "answer.json").write_text("{}")
    write_case(tmp_path, "null", 0)
    assert [path.name for path in folder.iterdir()] == ["answer.json"]


def test_the_log_whose_cost_is_measured_has_the_robots_joints(tmp_path):
    write_trot(tmp_path, 0.5, 500.0)
    robot, log = load_robot(tmp_path / "robot.urdf"), np.load(tmp_path / "log.npz")
    assert robot.floating
    assert len(log["t"]) == 250
    assert all(f"tau.{joint}" in log for joint in robot.joint_names)


@pytest.mark.parametrize("name", sorted(CAUSES))
def test_a_cause_changes_one_joint_alone(name):
    own = biped()
    before = Plant(own, own.numbers, sound(10))
    after = CAUSES[name](before, 4, 1.5)
    for part in ("mass", "armature", "damping", "friction"):
        assert np.flatnonzero(getattr(after.numbers, part) - getattr(before.numbers, part)).tolist() in ([], [4])
    for part in ("scale", "delay"):
        assert np.flatnonzero(getattr(after.drive, part) - getattr(before.drive, part)).tolist() in ([], [4])


def test_half_a_torque_is_as_many_floors_as_drives_ripple(rng):
    # Oracle: a run in which one joint lacks a torque that no tolerance makes, over the ripple in the band by its bell.
    own, rate, size = arm(), 500.0, 0.5
    run = simulate(own, own.numbers, sound(6), PERFECT, Ground(), HANGS, np.random.default_rng(3))
    lacks = np.zeros_like(run.given)
    lacks[:, 5] = size * np.sin(2 * np.pi * 7.0 * run.log["t"])
    gap = gap_over_floor(own, own.numbers, own.numbers, replace(run, given=run.given - lacks), rate)
    bell = np.sqrt(2 * np.log(2)) / (2 * np.pi * 20.0)
    passes = np.exp(-0.5 * (2 * np.pi * 7.0 * bell) ** 2)
    ripple = 0.1 * np.sqrt(0.001 / (2 * np.sqrt(np.pi) * bell))
    assert gap == pytest.approx(size * passes / np.sqrt(2) / ripple, rel=0.2)


def test_stance_shows_nothing_of_a_gap():
    own = quadruped()
    run = simulate(own, own.numbers, sound(12), PERFECT, Ground(), HANGS, np.random.default_rng(3))
    lacks = np.zeros_like(run.given)
    lacks[:, 5] = 0.5 * np.sin(2 * np.pi * 7.0 * run.log["t"])
    stands = np.zeros_like(run.touched)
    stands[:, 1] = 1.0
    run = replace(run, given=run.given - lacks)
    assert gap_over_floor(own, own.numbers, own.numbers, run, 500.0) > 2.0
    assert gap_over_floor(own, own.numbers, own.numbers, replace(run, touched=stands), 500.0) == 0.0
