"""Compiled motion of a robot and its links."""

# pyright: reportAttributeAccessIssue=false
from dataclasses import replace

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from phantom_dyn._kernels.single_state import at_root, invert, joint_rows, mass_and_bias
from phantom_dyn._kernels.tree_arrays import tree_arrays
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.model.loading import load_robot
from phantom_dyn.simulation.control import torque_over_time
from phantom_dyn.simulation.simulate import Cause, simulate
from places import ROBOTS


def test_an_arm_of_hinges_and_a_slide_falls_as_in_mujoco():
    model = mujoco.MjModel.from_xml_path(str(ROBOTS / "arm3.xml"))
    model.opt.timestep, model.dof_damping[:], model.dof_frictionloss[:] = 2e-5, 0.0, 0.0
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    data, t, expected = mujoco.MjData(model), np.linspace(0.0, 0.3, 16), []
    for when in t:
        while data.time < when - 1e-9:
            data.qfrc_applied[:] = [3.0, 5.0, -4.0]
            mujoco.mj_step(model, data)
        expected.append(data.qpos.copy())
    arm = load_robot(ROBOTS / "arm3.urdf")
    bare = replace(arm, viscous_friction=np.zeros(3), coulomb_friction=np.zeros(3))
    push = torque_over_time(t[[0, -1]], np.tile([3.0, 5.0, -4.0], (2, 1)))
    moved = simulate(bare, (), push, t, np.zeros(3), max_step=1e-4).links.q
    np.testing.assert_allclose(moved, expected, atol=1e-5 * np.abs(expected).max())


@pytest.fixture
def wheel(pendulum):
    """A rotor of 0.1 kg m^2 on a wheel of 0.2, without gravity and friction."""
    model = pendulum.model.copy()
    model.inertias[1] = pin.Inertia(1.0, np.zeros(3), np.diag([0.2, 0.2, 0.2]))
    model.armature, model.gravity = np.array([0.1]), pin.Motion.Zero()
    bare = replace(pendulum, model=model, viscous_friction=np.zeros(1), coulomb_friction=np.zeros(1))
    return replace(bare, torque_hold="zoh")


@pytest.mark.parametrize("steps", [1, 7])
def test_a_delay_of_whole_samples_shifts_the_command_by_them(wheel, steps):
    # Closed form: v[k + 1] - v[k] = tau[k - steps] h / (J + j); before the first command that one is assumed.
    t = np.arange(40) * 1e-3
    tau = np.random.default_rng(0).normal(size=(40, 1))
    late = Cause(effect_named("input_delay"), "pin", np.array([steps * 1e-3]))
    s = simulate(wheel, (late,), torque_over_time(t, tau), t, np.zeros(1), max_step=2.5e-4)
    shifted = tau[np.maximum(np.arange(39) - steps, 0), 0]
    np.testing.assert_allclose(np.diff(s.links.v[:, 0]), shifted * 1e-3 / 0.3, atol=1e-12)


def test_a_stuck_bristle_holds_a_pendulum_where_it_leans(pendulum):
    # Closed form: m g l sin(q) = 0.5 N m is below the 0.6 N m at which it slips.
    model = pendulum.model.copy()
    model.armature = np.array([0.1])
    hung = replace(pendulum, model=model, coulomb_friction=np.zeros(1), viscous_friction=np.full(1, 50.0))
    lean = np.arcsin(0.5 / (2 * 9.81 * 0.5))
    bristle = Cause(effect_named("presliding_friction"), "pin", np.array([0.6, 1e-3]))
    t = np.linspace(0.0, 2.0, 101)
    s = simulate(hung, (bristle,), torque_over_time(t[:2], np.zeros((2, 1))), t, np.array([lean]), max_step=1e-4)
    # Gravity and bristle in balance.
    rest = s.links.q[-1, 0]
    assert 2 * 9.81 * 0.5 * np.sin(rest) == pytest.approx(0.6 * (lean - rest) / 1e-3, rel=1e-4)
    assert abs(s.links.v[-1, 0]) < 1e-8


AXIS = np.array([0.48, -0.6, 0.64])

JOINTS = (
    pin.JointModelRX,
    pin.JointModelRZ,
    pin.JointModelPY,
    pin.JointModelRUBY,
    lambda: pin.JointModelPrismaticUnaligned(AXIS),
    lambda: pin.JointModelRevoluteUnaligned(AXIS),
)


def random_tree(seed: int, joints: int) -> pin.Model:
    """Joints of all kinds, each on the last one or on one that carries that: Pinocchio wants branches in a row."""
    rng, model, path = np.random.default_rng(seed), pin.Model(), [0]
    pin.seed(seed)
    for j in range(joints):
        made = JOINTS[rng.integers(len(JOINTS))]()
        path = path[: int(rng.integers(len(path))) + 1]
        body = model.addJoint(path[-1], made, pin.SE3.Random(), f"joint{j}")
        path.append(body)
        model.appendBodyToJoint(body, pin.Inertia.Random(), pin.SE3.Random())
    model.gravity = pin.Motion(rng.normal(size=3) * 9.81, np.zeros(3))
    return model


@pytest.mark.parametrize("joints", [1, 2, 5, 9])
@pytest.mark.parametrize("seed", range(4))
def test_mass_matrix_and_coasting_torque_of_a_branched_tree_are_pinocchios(joints, seed):
    model = random_tree(seed, joints)
    arrays = tree_arrays(model)
    assert arrays is not None
    rng = np.random.default_rng(seed)
    q, v = rng.uniform(-2.0, 2.0, (2, model.nv))
    mass, bias = np.zeros((model.nv, model.nv)), np.zeros(model.nv)
    mass_and_bias(*joint_rows(arrays), at_root(model.njoints, model.gravity.linear), q, v, mass, bias)

    configuration, data = np.empty(model.nq), model.createData()
    for joint in list(model.joints)[1:]:
        own = [q[joint.idx_v]] if joint.nq == 1 else [np.cos(q[joint.idx_v]), np.sin(q[joint.idx_v])]
        configuration[joint.idx_q : joint.idx_q + joint.nq] = own
    upper = np.triu(pin.crba(model, data, configuration))
    expected = upper + np.triu(upper, 1).T
    np.testing.assert_allclose(mass, expected, rtol=0.0, atol=1e-12 * np.abs(expected).max())
    coasting = pin.nonLinearEffects(model, data, configuration, v)
    np.testing.assert_allclose(bias, coasting, rtol=0.0, atol=1e-12 * np.abs(coasting).max())


@pytest.mark.parametrize("n", [1, 2, 3, 7])
def test_the_inverse_is_numpys(n, rng):
    half = rng.normal(size=(n, n))
    matrix = half @ half.T + np.eye(n)
    inverse = matrix.copy()
    assert invert(inverse)
    np.testing.assert_allclose(inverse, np.linalg.inv(matrix), atol=1e-12)


def test_a_matrix_that_is_not_positive_definite_is_not_inverted():
    # Known truth: eigenvalues 3 and -1.
    assert not invert(np.array([[1.0, 2.0], [2.0, 1.0]]))
