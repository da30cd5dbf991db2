# pyright: reportAttributeAccessIssue=false
"""Cases of a quadruped. Oracles: MuJoCo's mass matrix, Pinocchio's sum of bodies, and the log itself."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from benchmarks.legged.cases import CAUSES, Plant, write_case
from benchmarks.legged.quadruped import JOINTS, plant, stated, urdf
from benchmarks.legged.simulate import Drive, Task, simulate
from phantom_dyn.dynamics.dynamics import mass_matrix
from phantom_dyn.model.loading import load_robot

SOUND = Drive(np.ones(12), np.zeros(12), np.full(12, 1e9))
HANGS = Task(True, 0.3, 500.0, 1.0, 0.5, 0.16, 0.0, 60.0, 2.0)


def test_the_simulated_robot_is_the_one_of_the_file(tmp_path, rng):
    numbers = stated()
    (tmp_path / "robot.urdf").write_text(urdf(numbers))
    robot = load_robot(tmp_path / "robot.urdf")
    model = mujoco.MjModel.from_xml_string(plant(numbers, 0.001))
    data = mujoco.MjData(model)
    q = rng.normal(size=12)
    data.qpos[7:] = q
    mujoco.mj_forward(model, data)
    full = np.empty((18, 18))
    mujoco.mj_fullM(model, data, full)
    of_joints = {mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, k): k + 5 for k in range(1, 13)}
    order = [of_joints[name] for name in robot.joint_names]
    expected = full[np.ix_(order, order)] - np.diag(numbers.armature)[np.ix_(*[np.array(order) - 6] * 2)]
    np.testing.assert_allclose(mass_matrix(robot, q[None, np.array(order) - 6])[0], expected, atol=1e-9)


def test_a_payload_is_the_shank_with_a_point_mass():
    before, j = stated(), JOINTS.index("RL_calf_joint")
    after = CAUSES["payload"](Plant(before, SOUND), j, 2.0).numbers

    def body(numbers):
        return pin.Inertia(float(numbers.mass[j]), numbers.center[j], np.diag(numbers.mass[j] * numbers.radius[j] ** 2))

    added = body(after).toDynamicParameters() - body(before).toDynamicParameters()
    place = np.array([0.0, 0.0, -0.8 * 0.213])
    point = pin.Inertia(0.3, place, np.zeros((3, 3))).toDynamicParameters()
    # Products of inertia of the sum are left out, as the file has none: they are below a thousandth of its moments.
    np.testing.assert_allclose(added[[0, 1, 2, 3, 4, 6, 9]], point[[0, 1, 2, 3, 4, 6, 9]], atol=2e-5)


def test_a_weak_drive_lets_the_robot_lag_behind_its_references(rng):
    numbers, weak = stated(), replace(SOUND, scale=np.full(12, 0.2))
    lags = []
    for drive in (SOUND, weak):
        log = simulate(numbers, drive, HANGS, np.random.default_rng(3))
        lags.append(np.mean([np.std(log[f"q_ref.{joint}"] - log[f"q.{joint}"]) for joint in JOINTS]))
    assert lags[1] > 1.4 * lags[0]


def test_a_case_that_is_there_is_kept(tmp_path):
    folder = tmp_path / "null000"
    folder.mkdir()
    (folder / "answer.json").write_text("{}")
    write_case(tmp_path, "null", 0)
    assert [path.name for path in folder.iterdir()] == ["answer.json"]


@pytest.mark.parametrize("name", sorted(CAUSES))
def test_a_cause_changes_one_joint_alone(name):
    before = Plant(stated(), SOUND)
    after = CAUSES[name](before, 4, 1.5)
    for part in ("mass", "armature", "damping", "friction"):
        assert np.flatnonzero(getattr(after.numbers, part) - getattr(before.numbers, part)).tolist() in ([], [4])
    for part in ("scale", "delay"):
        assert np.flatnonzero(getattr(after.drive, part) - getattr(before.drive, part)).tolist() in ([], [4])
