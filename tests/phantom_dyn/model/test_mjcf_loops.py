"""MJCF files that carry their own loops; MuJoCo itself is the oracle."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from phantom_dyn.model.loading import load_robot
from phantom_dyn.dynamics.dynamics import forward_dynamics, mass_matrix
from phantom_dyn.dynamics.tree_motion import tree_motion
from phantom_dyn.errors import RobotError
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion
from places import ROBOTS

FOURBAR = ROBOTS / "fourbar.xml"
HINGE = '<joint name="{name}" axis="0 1 0" pos="0.01 0 -0.02"/><inertial pos="0.1 0 0" mass="1" diaginertia="1 1 1"/>'


def branch(side: str, turn: float) -> str:
    """Three hinged bodies in a row, turned against each other, joints off the origins, a site at the end."""
    inner = f'<site name="{side}_end" pos="0.2 0 0.1" euler="0 0.4 0"/>'
    for k in (3, 2, 1):
        inner = (
            f'<body name="{side}{k}" pos="0.2 0 0" euler="0 {turn * k} 0">'
            f"{HINGE.format(name=f'{side}{k}_hinge')}{inner}</body>"
        )
    return inner


@pytest.fixture
def two_branches(tmp_path) -> Callable[[str, str], tuple[Robot, mujoco.MjModel]]:
    """Two planar branches closed by an equality, all joints driven but the passive ones: the robot, MuJoCo's model."""

    def load(equality: str, passive: str) -> tuple[Robot, mujoco.MjModel]:
        names = [f"{side}{k}" for side in "ab" for k in (1, 2, 3)]
        motors = "".join(f'<motor joint="{name}_hinge"/>' for name in names if name not in passive.split())
        path = tmp_path / "branches.xml"
        path.write_text(
            f'<mujoco><compiler angle="radian"/><worldbody>{branch("a", 0.4)}{branch("b", -0.5)}</worldbody>'
            f"<equality>{equality}</equality><actuator>{motors}</actuator></mujoco>"
        )
        return load_robot(path), mujoco.MjModel.from_xml_path(str(path))

    return load


def state_of(model: mujoco.MjModel, names: list[str], q: np.ndarray, v: np.ndarray) -> mujoco.MjData:
    """MuJoCo's data at positions and velocities of joints that are named in another order."""
    data = mujoco.MjData(model)
    for name, position, speed in zip(names, q, v, strict=True):
        data.joint(name).qpos[0], data.joint(name).qvel[0] = position, speed
    mujoco.mj_forward(model, data)
    return data


def jacobian(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    return data.efc_J.reshape(-1, model.nv)[: data.ne].copy()


def closed_by_mujoco(robot: Robot, model: mujoco.MjModel, q: np.ndarray, v: np.ndarray) -> mujoco.MjData:
    tree = tree_motion(robot, Motion(np.zeros(1), q, v, 0 * v))
    return state_of(model, list(robot.model.names)[1:], tree.q[0], tree.v[0])


@pytest.mark.parametrize(
    ("equality", "passive"),
    [
        ('<connect body1="a3" body2="b3" anchor="0.1 0 0.05"/>', "b1 b2"),
        ('<connect body1="a3" anchor="0.1 0 0.05"/>', "a2 a3"),
        ('<connect site1="a_end" site2="b_end"/>', "b2 b3"),
        ('<weld body1="a3" body2="b3"/>', "b1 b2 b3"),
        ('<weld body1="a3" body2="b3" anchor="0.1 0 -0.1"/>', "b1 b2 b3"),
        ('<weld body1="a3" body2="b3" relpose="0.05 0 0.1 0.9 0 0.1 0"/>', "b1 b2 b3"),
        ('<weld body1="a3" body2="b3" anchor="0.1 0 -0.1" torquescale="0"/>', "b2 b3"),
        ('<weld site1="a_end" site2="b_end"/>', "b1 b2 b3"),
    ],
)
def test_every_kind_of_equality_is_closed_where_mujoco_closes_it(two_branches, rng, equality, passive):
    robot, model = two_branches(equality, passive)
    active = list(robot.chain.active)
    q = robot.chain.start[active][None] + rng.uniform(-0.02, 0.02, (1, len(active)))
    data = closed_by_mujoco(robot, model, q, rng.normal(size=(1, len(active))))
    np.testing.assert_allclose(data.efc_pos[: data.ne], 0, atol=1e-9)
    np.testing.assert_allclose(jacobian(model, data) @ data.qvel, 0, atol=1e-9)


def test_joints_of_a_loop_without_an_actuator_are_passive():
    robot = load_robot(FOURBAR)
    assert (robot.joint_names, robot.passive_names) == (("drive",), ("knee", "follower"))


def test_bodies_beside_the_first_one_are_in_the_model():
    # Pinocchio 4.1 alone drops them.
    model = mujoco.MjModel.from_xml_path(str(FOURBAR))
    robot = load_robot(FOURBAR)
    data = closed_by_mujoco(robot, model, np.array([[0.2]]), np.zeros((1, 1)))
    full = np.zeros((3, 3))
    mujoco.mj_fullM(model, data, full)
    G = tree_motion(robot, Motion(np.zeros(1), *np.full((3, 1, 1), 0.2))).G[0]
    np.testing.assert_allclose(mass_matrix(robot, np.array([[0.2]]))[0], G.T @ full @ G, rtol=1e-9)


def test_an_inactive_equality_closes_nothing(tmp_path):
    path = tmp_path / "open.xml"
    path.write_text(FOURBAR.read_text().replace('name="pin"', 'name="pin" active="false"'))
    assert load_robot(path).joint_names == ("drive", "knee", "follower")


def test_a_four_bar_accelerates_as_the_constrained_equations_of_mujoco(rng):
    # M, bias and constraint Jacobian are MuJoCo's; its slope along the motion by central differences.
    robot, model = load_robot(FOURBAR), mujoco.MjModel.from_xml_path(str(FOURBAR))
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    for _ in range(10):
        q, v, tau = rng.uniform(-0.4, 0.4, (1, 1)), rng.normal(size=(1, 1)), rng.normal(size=(1, 1))
        data = closed_by_mujoco(robot, model, q, v)
        J, mass = jacobian(model, data), np.zeros((3, 3))
        mujoco.mj_fullM(model, data, mass)
        step, names = 1e-5, [model.joint(j).name for j in range(3)]
        sides = [
            jacobian(model, state_of(model, names, data.qpos + sign * step * data.qvel, data.qvel)) for sign in (1, -1)
        ]
        bias = (sides[0] - sides[1]) / (2 * step) @ data.qvel
        drive = np.array([tau[0, 0] if name == "drive" else 0.0 for name in names])
        left = np.block([[mass, J.T], [J, np.zeros((3, 3))]])
        solved = np.linalg.lstsq(left, np.concatenate([drive - data.qfrc_bias, -bias]), rcond=1e-10)[0]
        assert forward_dynamics(robot, q, v, tau)[0, 0] == pytest.approx(solved[names.index("drive")], rel=1e-7)


def test_a_four_bar_accelerates_as_mujoco_simulates_it_with_stiff_constraints(rng):
    robot, model = load_robot(FOURBAR), mujoco.MjModel.from_xml_path(str(FOURBAR))
    # As stiff as MuJoCo allows; it then gives way by 1e-4 of the constraint's acceleration.
    model.eq_solref[0], model.eq_solimp[0, :2] = [0.002, 1.0], 0.9999
    model.opt.tolerance, model.opt.iterations = 0.0, 200
    for _ in range(10):
        q, v, tau = rng.uniform(-0.4, 0.4, (1, 1)), rng.normal(size=(1, 1)), rng.normal(size=(1, 1))
        data = closed_by_mujoco(robot, model, q, v)
        data.joint("drive").qfrc_applied[0] = tau[0, 0]
        mujoco.mj_forward(model, data)
        a = forward_dynamics(robot, q, v, tau)
        tree = tree_motion(robot, Motion(np.zeros(1), q, v, a))
        found = [data.joint(name).qacc[0] for name in list(robot.model.names)[1:]]
        np.testing.assert_allclose(found, tree.a[0], rtol=2e-3, atol=2e-3 * np.abs(tree.a).max())


def test_expressions_may_stand_for_a_loop_of_the_file(tmp_path):
    # Closed form: a parallelogram, for which robot.yaml states what the file closes by points.
    path, config = tmp_path / "parallelogram.xml", tmp_path / "robot.yaml"
    body = (
        '<body name="{0}" pos="{1}"><joint name="{0}_j" axis="0 1 0"/>'
        '<inertial pos="0 0 0.1" mass="1" diaginertia="1 1 1"/>{2}</body>'
    )
    coupler = body.format("coupler", "0 0 0.2", "")
    path.write_text(
        f"<mujoco><worldbody>{body.format('crank', '0 0 0', coupler)}{body.format('rocker', '0.3 0 0', '')}</worldbody>"
        '<equality><connect body1="coupler" body2="rocker" anchor="0.3 0 0"/></equality></mujoco>'
    )
    config.write_text("loops: [{kind: linear, active: [crank_j], passive: {coupler_j: -crank_j, rocker_j: crank_j}}]")
    linear = load_robot(path, config=config)
    config.write_text("joints: {coupler_j: {actuated: false}, rocker_j: {actuated: false}}")
    numeric = load_robot(path, config=config)
    q = np.array([[0.3], [-0.8]])
    assert linear.chain.anchors == ()
    np.testing.assert_allclose(linear.configuration(q), numeric.configuration(q), atol=1e-10)


def test_this_pinocchio_is_built_without_sdf():
    # The functions for SDF exist all the same; the sentence of read_root rests on this flag.
    assert not pin.WITH_SDFORMAT


def test_an_sdf_file_is_refused_with_what_to_do(tmp_path):
    path = tmp_path / "robot.sdf"
    path.write_text('<sdf version="1.9"><model name="arm"/></sdf>')
    with pytest.raises(RobotError, match="is an SDF file, and Pinocchio's wheel is built without SDF: convert it to"):
        load_robot(path)
