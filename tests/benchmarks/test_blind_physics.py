"""The robots of the sealed cases against Pinocchio, published values and the contract."""

# pyright: reportAttributeAccessIssue=false
from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from moved_robots import (
    TRUSTED,
    friction_torque,
    motion_of,
    moving,
    pinocchio_model,
    pinocchio_torque,
    short_setup,
)

from benchmarks.gapbench.generator.arms import ARMS, arm, phantom
from benchmarks.gapbench.generator.drives import ROBOTS, draw_table
from benchmarks.gapbench.generator.effects import plant_with
from benchmarks.gapbench.generator.files import robot_yaml
from benchmarks.gapbench.generator.inverse import rigid_torque
from benchmarks.gapbench.generator.plant import Plant, compiled
from benchmarks.gapbench.generator.robots import Tolerance, perturbed
from benchmarks.gapbench.generator.setup import logged_torque, run_of
from benchmarks.gapbench.generator.simulate import feedforward
from benchmarks.gapbench.generator.sizing import rms
from phantom_dyn.model.robot_files import examples_folder


@pytest.mark.parametrize("robot", ROBOTS)
def test_urdf_and_moving_robot_have_the_inverse_dynamics_of_pinocchio(robot, rng):
    table = draw_table(rng, robot)
    q, v, a = rng.normal(size=(3, 20, len(table.joints)))
    wanted = pinocchio_torque(table, q, v, a)
    np.testing.assert_allclose(rigid_torque(table, q, v, a), wanted, rtol=1e-6, atol=1e-7 * np.abs(wanted).max())


@pytest.mark.parametrize("name", ARMS)
def test_an_arm_is_that_of_example_robot_data_with_its_fingers_locked(name, rng):
    """Pinocchio reads the same file itself."""
    full = pin.buildModelFromUrdf(str(examples_folder() / ARMS[name]))
    fingers = [full.getJointId(joint) for joint in full.names if "finger" in joint]
    model = pin.buildReducedModel(full, fingers, pin.neutral(full)) if fingers else full
    q, v, a = rng.normal(size=(3, 10, model.nv))
    data = model.createData()
    wanted = np.array([pin.rnea(model, data, *row) for row in zip(q, v, a, strict=True)])
    np.testing.assert_allclose(rigid_torque(arm(name), q, v, a), wanted, rtol=1e-6, atol=1e-6)


def test_the_phantom_has_the_published_mass_matrix_at_its_origin():
    none, unit = np.zeros((3, 3)), np.eye(3)
    gravity = rigid_torque(phantom(), none, none, none)
    published = np.diag([3.573480e-3, 2.426396e-3, 9.318856e-4])
    np.testing.assert_allclose(rigid_torque(phantom(), none, none, unit) - gravity, published, atol=1e-8)


def test_the_phantom_has_the_published_gravity():
    q, none = np.array([[0.3, 0.4, -0.5], [0.2, 0.3, 0.4]]), np.zeros((2, 3))
    published = [[0.0, -1.5011488646e-2, 3.5360131135e-2], [0.0, -1.5570112027e-2, -2.8721631498e-2]]
    np.testing.assert_allclose(rigid_torque(phantom(), q, none, none), published, atol=1e-6)


def test_the_loop_of_the_phantom_is_stated_as_the_contract_writes_it():
    text = robot_yaml(phantom(), torque_hold="zoh", encoder_counts=4096, tolerance=Tolerance())
    assert (
        "  - {kind: linear, active: [theta1, theta2, theta3], "
        'passive: {elbow: "theta3 - theta2", crank: "theta2 - theta3"}}' in text
    )


def error_of_the_log(setup, *, written, read):
    """Inverse dynamics (Pinocchio) of nothing but the log against its torque, relative, worst joint."""
    run, rate = run_of(setup), setup.session.rate
    q, v, a = motion_of(run, rate)
    wanted = pinocchio_torque(setup.owner, q, v, a) + friction_torque(setup.owner, v)
    if read == "zoh":
        wanted = 0.5 * (wanted + np.vstack([wanted[1:], wanted[-1:]]))
    tau, keep = logged_torque(run, written), moving(v)
    keep[[0, 1, -2, -1]] = False
    return (rms((tau - wanted)[keep]) / rms(tau[keep])).max()


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("hold", ["zoh", "instant"])
def test_a_null_without_noise_and_tolerance_satisfies_the_equation_of_motion(robot, hold):
    """A tenth of the smallest disturbance that is drawn; the PHANToM moves as a closed chain, not as that tree."""
    assert error_of_the_log(short_setup(3, robot), written=hold, read=hold) < 1e-3


@pytest.mark.parametrize(("written", "read"), [("zoh", "instant"), ("instant", "zoh")])
def test_half_a_sample_matters_to_that_comparison(written, read):
    setup = short_setup(3, "planar2")
    right = error_of_the_log(setup, written=written, read=written)
    assert error_of_the_log(setup, written=written, read=read) > 2.0 * right


def test_coulomb_friction_holds_a_joint_still_under_a_smaller_load(rng):
    """Closed form: below its level dry friction sticks, so the pendulum stays where it was put."""
    import mujoco

    table = draw_table(rng, "pendulum")
    weight = abs(rigid_torque(table, np.array([[0.5]]), np.zeros((1, 1)), np.zeros((1, 1)))[0, 0])
    stuck = replace(table, links=(replace(table.links[0], coulomb=1.2 * weight, viscous=0.0),))
    model = compiled(Plant(stuck))
    data = mujoco.MjData(model)
    data.qpos[:] = 0.5
    mujoco.mj_step(model, data, 8000)
    assert abs(data.qpos[0] - 0.5) < 1e-3


@pytest.mark.parametrize("full", [False, True])
def test_every_property_of_the_true_robot_is_within_two_tolerances(full, rng):
    table, tolerance = draw_table(rng, "spatial3"), Tolerance()
    for _ in range(50):
        for mine, true in zip(table.links, perturbed(rng, table, tolerance, full=full).links, strict=True):
            assert abs(true.mass / mine.mass - 1.0) <= 2.0 * tolerance.inertia
            assert abs(true.coulomb / mine.coulomb - 1.0) <= 2.0 * tolerance.friction
            assert abs(true.rotor_inertia / mine.rotor_inertia - 1.0) <= 2.0 * tolerance.rotor_inertia


def test_a_trusted_robot_is_its_model(rng):
    table = draw_table(rng, "planar2")
    assert perturbed(rng, table, TRUSTED) == table


def test_feedforward_of_a_resting_arm_is_its_weight(rng):
    table = draw_table(rng, "planar2")
    still = np.full((10, 2), 0.3)
    weight = pin.computeGeneralizedGravity(pinocchio_model(table), pinocchio_model(table).createData(), still[0])
    np.testing.assert_allclose(feedforward(table, still, 500.0)[5], weight, rtol=1e-6)


def test_no_effect_is_the_bare_machine(rng):
    table = draw_table(rng, "pendulum")
    assert plant_with((), table) == Plant(table)
