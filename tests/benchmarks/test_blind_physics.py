"""The generator of the sealed cases against Pinocchio, published values and the contract's laws."""

# pyright: reportAttributeAccessIssue=false
from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

# The benchmarks are no part of the installed packages.
sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from benchmarks.blind.generator.arms import ARMS, arm, phantom
from benchmarks.blind.generator.drives import ROBOTS, draw_table
from benchmarks.blind.generator.effects import Effect, plant_with
from benchmarks.blind.generator.files import robot_yaml, urdf_text
from benchmarks.blind.generator.inverse import rigid_torque
from benchmarks.blind.generator.plant import Outside, Plant, compiled
from benchmarks.blind.generator.reference import draw_reference
from benchmarks.blind.generator.robots import Tolerance, perturbed
from benchmarks.blind.generator.setup import draw_setup, logged_torque, quiet, run_of
from benchmarks.blind.generator.simulate import feedforward
from benchmarks.blind.generator.sizing import at_samples, rms
from phantom_dyn.robot_files import examples_folder

TRUSTED = Tolerance(0.0, 0.0, 0.0)


def pinocchio_model(table):
    model = pin.buildModelFromXML(urdf_text(table))
    model.armature = np.array([link.rotor_inertia for link in table.links])
    model.gravity.linear = np.array(table.gravity)
    return model


def pinocchio_torque(table, q, v, a):
    """Torque of the active joints: that of the tree, projected where the robot is a closed chain."""
    model, select = pinocchio_model(table), table.selection()
    data = model.createData()
    rows = zip(q @ select.T, v @ select.T, a @ select.T, strict=True)
    return np.array([pin.rnea(model, data, *row) for row in rows]) @ select


def friction_torque(table, v):
    """Torque that modelled friction asks of the drive: c v + T sign(v)."""
    viscous, coulomb = (np.array([getattr(link, name) for link in table.driven]) for name in ("viscous", "coulomb"))
    return viscous * v + coulomb * np.sign(v)


def short_setup(seed, robot, seconds=8.0):
    """A trusted robot without noise on a Fourier motion, which hardly ever stands still."""
    setup = quiet(draw_setup(seed, robot=robot, tolerance=TRUSTED))
    session = setup.session
    t = np.arange(round(seconds * session.rate)) / session.rate
    reference = draw_reference(np.random.default_rng(seed), setup.owner, "fourier", t)
    none = np.zeros_like(reference)
    return replace(setup, session=replace(session, reference=reference, disturbance=none, dither=none))


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


def moving(v):
    """Samples with no reversal near: at one, the sign of v changes within a sample."""
    return (np.abs(v) > 0.05).all(axis=1)


def motion_of(run, rate):
    """q, v, a of what the encoders read, by central differences."""
    q, a = run.seen, np.zeros_like(run.seen)
    a[1:-1] = (q[2:] - 2.0 * q[1:-1] + q[:-2]) * rate**2
    return q, np.gradient(q, 1.0 / rate, axis=0), a


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


LAWS = {
    "viscous_friction": ({"coefficient": 0.3}, lambda q, v, a, p: -p["coefficient"] * v),
    "coulomb_friction": ({"torque": 0.3}, lambda q, v, a, p: -p["torque"] * np.sign(v)),
    "direction_dependent_friction": (
        {"torque_positive": 0.3, "torque_negative": 0.1, "coefficient_positive": 0.05, "coefficient_negative": 0.2},
        lambda q, v, a, p: np.where(
            v > 0,
            -(p["torque_positive"] + p["coefficient_positive"] * v),
            p["torque_negative"] - p["coefficient_negative"] * v,
        ),
    ),
    "stribeck_friction": (
        {"coulomb_torque": 0.1, "static_torque": 0.3, "stribeck_velocity": 0.2},
        lambda q, v, a, p: (
            -(
                p["coulomb_torque"]
                + (p["static_torque"] - p["coulomb_torque"]) * np.exp(-((v / p["stribeck_velocity"]) ** 2))
            )
            * np.sign(v)
        ),
    ),
    "torque_offset": ({"torque": -0.4}, lambda q, v, a, p: np.full_like(v, p["torque"])),
    "rotor_inertia": ({"inertia": 0.02}, lambda q, v, a, p: -p["inertia"] * a),
    "parasitic_spring": (
        {"stiffness": 0.5, "rest_position": 0.2},
        lambda q, v, a, p: -p["stiffness"] * (q - p["rest_position"]),
    ),
    "cogging": (
        {"order": 8.0, "amplitude": 0.3, "phase": 0.4},
        lambda q, v, a, p: p["amplitude"] * np.sin(p["order"] * q + p["phase"]),
    ),
}


def missing_torque(setup, *effects, outside=None):
    """Torque that the moving robot gets besides the logged one, from the truth of the run: needed less logged."""
    run = run_of(setup, *effects, outside=outside)
    q, v, a = motion_of(run, setup.session.rate)
    needed = pinocchio_torque(setup.truth, q, v, a) + friction_torque(setup.truth, v)
    return needed - at_samples(run.command), run, (q, v, a)


def kept(v):
    """Moving samples without the two at either end, where differences have no neighbour."""
    keep = moving(v)
    keep[[0, 1, -2, -1]] = False
    return keep


@pytest.mark.parametrize("joint", [0, 1])
@pytest.mark.parametrize("name", LAWS)
def test_a_joint_effect_acts_on_the_moving_robot_as_the_contract_states(name, joint):
    setup = short_setup(5, "planar2")
    parameters, law = LAWS[name]
    found, _, (q, v, a) = missing_torque(setup, Effect(name, joint, parameters))
    wanted = np.zeros_like(found)
    wanted[:, joint] = law(q[:, joint], v[:, joint], a[:, joint], parameters)
    keep = kept(v)
    assert rms((found - wanted)[keep]).max() < 1e-2 * rms(wanted[keep])[joint]


def test_friction_that_grows_with_load_takes_a_share_of_what_the_transmission_passes():
    setup = short_setup(5, "planar2")
    found, _, (q, v, a) = missing_torque(setup, Effect("load_dependent_friction", 1, {"ratio": 0.1}))
    bare = setup.truth.with_link(1, replace(setup.truth.links[1], rotor_inertia=0.0))
    wanted = -0.1 * np.abs(pinocchio_torque(bare, q, v, a)[:, 1]) * np.sign(v[:, 1])
    keep = kept(v)
    assert rms((found[:, 1] - wanted)[keep, None])[0] < 0.02 * rms(wanted[keep, None])[0]


def test_a_coupling_brakes_both_joints_by_what_turns_with_both():
    setup = short_setup(5, "planar2")
    p = {"ratio": -0.7, "coulomb_torque": 0.2, "coefficient": 0.1, "inertia": 0.02}
    found, _, (_, v, a) = missing_torque(setup, Effect("joint_coupling", 0, p, 1))
    w, dw = v @ [1.0, -0.7], a @ [1.0, -0.7]
    law = -(0.2 * np.sign(w) + 0.1 * w + 0.02 * dw)
    keep = kept(v) & (np.abs(w) > 0.05)
    assert rms((found - np.outer(law, [1.0, -0.7]))[keep]).max() < 0.02 * rms(law[keep, None])[0]


@pytest.mark.parametrize(("joint", "signs"), [("elbow", (0.0, -1.0, 1.0)), ("crank", (0.0, 1.0, -1.0))])
def test_friction_of_a_passive_joint_reaches_both_drives_that_move_it(joint, signs):
    setup = short_setup(5, "phantom")
    i = next(i for i, link in enumerate(setup.owner.links) if link.joint == joint)
    found, _, (_, v, _) = missing_torque(setup, Effect("viscous_friction", i, {"coefficient": 0.01}))
    wanted = -0.01 * np.outer(v @ signs, signs)
    keep = kept(v)
    assert rms((found - wanted)[keep]).max() < 0.01 * rms(wanted[keep]).max()


def test_a_torque_constant_scales_the_logged_torque():
    setup = short_setup(6, "planar2")
    found, run, (_, v, _) = missing_torque(setup, Effect("torque_constant", 1, {"ratio": 1.3}))
    tau = at_samples(run.command)
    keep = kept(v)
    np.testing.assert_allclose(found[keep, 1], 0.3 * tau[keep, 1], atol=3e-3 * np.abs(tau[:, 1]).max())


def test_a_payload_is_a_point_mass_in_the_frame_of_the_last_joint():
    """Pinocchio adds the same point mass to the last body of the owner's model."""
    setup = short_setup(7, "spatial3")
    center = np.array([0.1, 0.02, -0.05])
    parameters = {"mass": 0.4, **{f"center_{axis}": float(x) for axis, x in zip("xyz", center, strict=True)}}
    run = run_of(setup, Effect("payload", 2, parameters))
    q, v, a = motion_of(run, setup.session.rate)
    model = pinocchio_model(setup.owner)
    model.inertias[3] = model.inertias[3] + pin.Inertia(0.4, center, np.zeros((3, 3)))
    data = model.createData()
    wanted = np.array([pin.rnea(model, data, *row) for row in zip(q, v, a, strict=True)])
    left = at_samples(run.command) - wanted - friction_torque(setup.owner, v)
    assert (rms(left[kept(v)]) / rms(run.command)).max() < 1e-3


def test_inertial_parameters_change_one_link_by_the_stated_factors():
    setup = short_setup(8, "planar2")
    factors = {"mass_factor": 1.4, "center_factor": 0.8, "inertia_factor": 1.5}
    run = run_of(setup, Effect("inertial_parameters", 0, factors))
    q, v, a = motion_of(run, setup.session.rate)
    model = pinocchio_model(setup.owner)
    old = model.inertias[1]
    model.inertias[1] = pin.Inertia(1.4 * old.mass, 0.8 * old.lever, 1.5 * old.inertia)
    data = model.createData()
    wanted = np.array([pin.rnea(model, data, *row) for row in zip(q, v, a, strict=True)])
    left = at_samples(run.command) - wanted - friction_torque(setup.owner, v)
    assert (rms(left[kept(v)]) / rms(run.command)).max() < 1e-3


def test_a_tilted_base_turns_gravity_first_about_y_then_about_x():
    """Pinocchio with gravity turned by its own rotation matrices."""
    setup = short_setup(9, "spatial3")
    run = run_of(setup, Effect("base_tilt", -1, {"roll": 0.2, "pitch": -0.1}))
    q, v, a = motion_of(run, setup.session.rate)
    gravity = pin.utils.rotate("x", 0.2) @ pin.utils.rotate("y", -0.1) @ np.array([0.0, 0.0, -9.81])
    wanted = pinocchio_torque(replace(setup.owner, gravity=tuple(gravity)), q, v, a) + friction_torque(setup.owner, v)
    assert (rms((at_samples(run.command) - wanted)[kept(v)]) / rms(run.command)).max() < 1e-3


READINGS = {
    "encoder_offset": ({"offset": 0.1}, lambda q: q + 0.1),
    "encoder_eccentricity": (
        {"amplitude": 0.05, "phase": 0.3, "order": 1.0},
        lambda q: q + 0.05 * np.sin(q + 0.3),
    ),
    "encoder_quantization": ({"step": 0.01}, lambda q: 0.01 * np.round(q / 0.01)),
}


@pytest.mark.parametrize("name", READINGS)
def test_a_wrong_encoder_reads_as_the_contract_states(name):
    parameters, law = READINGS[name]
    run = run_of(short_setup(5, "planar2", seconds=2.0), Effect(name, 1, parameters))
    np.testing.assert_allclose(run.seen[:, 1], law(run.q[:, 1]), atol=1e-12)


OUTSIDE = {
    "friction_warm_up": (
        {"torque": 0.2, "time_constant": 3.0, "settled": 0.1},
        lambda t, q, v: -0.2 * (np.exp(-t / 3.0) - 0.1) * np.sign(v),
    ),
    "shaker": (
        {"amplitude": 0.3, "frequency": 2.0, "phase": 0.5},
        lambda t, q, v: 0.3 * np.sin(2.0 * np.pi * 2.0 * t + 0.5),
    ),
    "soft_contact": (
        {"stiffness": 3.0, "damping": 0.06, "position": 0.1, "side": 1.0},
        lambda t, q, v: -np.maximum(3.0 * (q - 0.1) + 0.06 * v, 0.0) * (q > 0.1),
    ),
    "drifting_offset": ({"torque": 0.3, "duration": 8.0}, lambda t, q, v: 0.3 * (2.0 * t / 8.0 - 1.0)),
}


@pytest.mark.parametrize("name", OUTSIDE)
def test_a_cause_outside_the_catalogue_acts_as_the_readme_states(name):
    setup = short_setup(5, "planar2")
    parameters, law = OUTSIDE[name]
    found, run, (q, v, _) = missing_torque(setup, outside=Outside(name, 1, parameters))
    wanted, keep = law(run.t, q[:, 1], v[:, 1]), kept(v)
    assert rms((found[:, 1] - wanted)[keep, None])[0] < 0.02 * rms(wanted[keep, None])[0]


def test_a_sagging_supply_takes_torque_in_proportion_to_the_load_of_all_drives():
    """Independent recursion over the logged torques."""
    setup = short_setup(5, "planar2")
    p = {"depth": 0.2, "scale": 20.0, "time_constant": 0.1}
    found, run, (_, v, _) = missing_torque(setup, outside=Outside("voltage_sag", -1, p))
    load, share = 1.0, []
    for tau in run.command:
        load += (1.0 - np.exp(-1.0 / (0.1 * setup.session.rate))) * (np.abs(tau).sum() / 20.0 - load)
        share.append(-0.2 * (load - 1.0))
    wanted = at_samples(run.command * np.array(share)[:, None])
    keep = kept(v)
    assert (rms((found - wanted)[keep]) / rms(wanted[keep])).max() < 0.03


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
