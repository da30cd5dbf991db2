"""The generator of the sealed cases against Pinocchio, closed forms and the contract's laws."""

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

from benchmarks.blind.generator.case import draw_setup, logged_torque, quiet, run_of
from benchmarks.blind.generator.effects import Effect, Recipe, needed_torque, plant_with
from benchmarks.blind.generator.plant import bare_plant, compiled, rigid_torque
from benchmarks.blind.generator.reference import draw_reference
from benchmarks.blind.generator.rivals import alike
from benchmarks.blind.generator.robots import ROBOTS, Tolerance, draw_table, perturbed, urdf_text
from benchmarks.blind.generator.simulate import feedforward, midpoint_motion
from benchmarks.blind.generator.sizing import banded, paired_gap, rms, ruler, sized

TRUSTED = Tolerance(0.0, 0.0, 0.0)


def pinocchio_model(table):
    model = pin.buildModelFromXML(urdf_text(table))
    model.armature = np.array([link.rotor_inertia for link in table.links])
    return model


def pinocchio_torque(model, q, v, a):
    data = model.createData()
    return np.array([pin.rnea(model, data, *row) for row in zip(q, v, a, strict=True)])


def friction_torque(table, v):
    """Torque that modelled friction asks of the drive: c v + T sign(v)."""
    viscous, coulomb = (np.array([getattr(link, name) for link in table.links]) for name in ("viscous", "coulomb"))
    return viscous * v + coulomb * np.sign(v)


def short_setup(seed, robot, seconds=8.0):
    """A trusted robot without noise on a Fourier motion, which hardly ever stands still."""
    setup = quiet(draw_setup(seed, robot=robot, tolerance=TRUSTED))
    session = setup.session
    t = np.arange(round(seconds * session.rate)) / session.rate
    reference = draw_reference(np.random.default_rng(seed), robot, "fourier", t)
    none = np.zeros_like(reference)
    return replace(setup, session=replace(session, reference=reference, disturbance=none, dither=none))


@pytest.mark.parametrize("robot", ROBOTS)
def test_urdf_and_moving_robot_have_the_inverse_dynamics_of_pinocchio(robot, rng):
    table = draw_table(rng, robot)
    q, v, a = rng.normal(size=(3, 20, len(table.links)))
    np.testing.assert_allclose(
        rigid_torque(table, q, v, a), pinocchio_torque(pinocchio_model(table), q, v, a), rtol=1e-6, atol=1e-8
    )


def moving(v):
    """Samples with no reversal near: at one, the sign of v changes within a sample."""
    return (np.abs(v) > 0.05).all(axis=1)


def error_of_the_log(setup, *, written, read):
    """Inverse dynamics (Pinocchio) of nothing but the log against its torque, relative, worst joint."""
    run, rate = run_of(setup, None), setup.session.rate
    q = run.measured
    v = np.gradient(q, 1.0 / rate, axis=0)
    a = np.zeros_like(q)
    a[1:-1] = (q[2:] - 2.0 * q[1:-1] + q[:-2]) * rate**2
    wanted = pinocchio_torque(pinocchio_model(setup.owner), q, v, a) + friction_torque(setup.owner, v)
    if read == "zoh":
        wanted = 0.5 * (wanted + np.vstack([wanted[1:], wanted[-1:]]))
    tau, keep = logged_torque(run, written), moving(v)
    keep[[0, 1, -2, -1]] = False
    return (rms((tau - wanted)[keep]) / rms(tau[keep])).max()


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("hold", ["zoh", "instant"])
def test_a_null_without_noise_and_tolerance_satisfies_the_equation_of_motion(robot, hold):
    assert error_of_the_log(short_setup(3, robot), written=hold, read=hold) < 2e-4


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
}


def missing_torque(setup, effect):
    """Torque that the moving robot gets besides the logged one, from the truth of the run: needed less logged."""
    run = run_of(setup, effect)
    q, v, a = midpoint_motion(run)
    needed = pinocchio_torque(pinocchio_model(setup.truth), q, v, a) + friction_torque(setup.truth, v)
    return needed - run.command, run, (q, v, a)


@pytest.mark.parametrize("joint", [0, 1])
@pytest.mark.parametrize("name", LAWS)
def test_a_joint_effect_acts_on_the_moving_robot_as_the_contract_states(name, joint):
    setup = short_setup(5, "planar2")
    parameters, law = LAWS[name]
    found, _, (q, v, a) = missing_torque(setup, Effect(name, joint, parameters))
    wanted = np.zeros_like(found)
    wanted[:, joint] = law(q[:, joint], v[:, joint], a[:, joint], parameters)
    keep = moving(v)
    assert rms((found - wanted)[keep]).max() < 5e-3 * rms(wanted[keep])[joint]


@pytest.mark.parametrize("name", LAWS)
def test_the_size_of_a_joint_effect_is_taken_from_its_law(name, rng):
    table = draw_table(rng, "spatial3")
    parameters, law = LAWS[name]
    q, v, a = rng.normal(size=(3, 50, 3))
    v = np.where(np.abs(v) < 0.02, 0.02, v)  # below, the size is taken with a steep ramp instead of the step
    needed = needed_torque(Effect(name, 1, parameters), table, q, v, a, tau=np.zeros_like(q))
    np.testing.assert_allclose(needed[:, 1], -law(q[:, 1], v[:, 1], a[:, 1], parameters), atol=1e-6)


def test_a_torque_constant_scales_the_logged_torque():
    setup = short_setup(6, "planar2")
    found, run, (_, v, _) = missing_torque(setup, Effect("torque_constant", 1, {"ratio": 1.3}))
    np.testing.assert_allclose(found[moving(v), 1], 0.3 * run.command[moving(v), 1], atol=2e-3)


def test_a_payload_is_a_point_mass_in_the_frame_of_the_last_joint():
    """Pinocchio adds the same point mass to the last body of the owner's model."""
    setup = short_setup(7, "spatial3")
    center = np.array([0.1, 0.02, -0.05])
    parameters = {"mass": 0.4, **{f"center_{axis}": float(x) for axis, x in zip("xyz", center, strict=True)}}
    run = run_of(setup, Effect("payload", 2, parameters))
    q, v, a = midpoint_motion(run)
    model = pinocchio_model(setup.owner)
    model.inertias[3] = model.inertias[3] + pin.Inertia(0.4, center, np.zeros((3, 3)))
    wanted = pinocchio_torque(model, q, v, a) + friction_torque(setup.owner, v)
    assert (rms((run.command - wanted)[moving(v)]) / rms(run.command)).max() < 1e-4


def test_inertial_parameters_change_one_link_by_the_stated_factors():
    setup = short_setup(8, "planar2")
    factors = {"mass_factor": 1.4, "center_factor": 0.8, "inertia_factor": 1.5}
    run = run_of(setup, Effect("inertial_parameters", 0, factors))
    q, v, a = midpoint_motion(run)
    model = pinocchio_model(setup.owner)
    old = model.inertias[1]
    model.inertias[1] = pin.Inertia(1.4 * old.mass, 0.8 * old.lever, 1.5 * old.inertia)
    wanted = pinocchio_torque(model, q, v, a) + friction_torque(setup.owner, v)
    assert (rms((run.command - wanted)[moving(v)]) / rms(run.command)).max() < 1e-4


def test_coulomb_friction_holds_a_joint_still_under_a_smaller_load(rng):
    """Closed form: below its level dry friction sticks, so the pendulum stays where it was put."""
    import mujoco

    table = draw_table(rng, "pendulum")
    weight = abs(rigid_torque(table, np.array([[0.5]]), np.zeros((1, 1)), np.zeros((1, 1)))[0, 0])
    stuck = replace(table, links=(replace(table.links[0], coulomb=1.2 * weight, viscous=0.0),))
    model = compiled(bare_plant(stuck))
    data = mujoco.MjData(model)
    data.qpos[:] = 0.5
    mujoco.mj_step(model, data, 8000)
    assert abs(data.qpos[0] - 0.5) < 1e-3


def test_every_property_of_the_true_robot_is_within_two_tolerances(rng):
    table, tolerance = draw_table(rng, "spatial3"), Tolerance()
    for _ in range(50):
        for mine, true in zip(table.links, perturbed(rng, table, tolerance).links, strict=True):
            assert abs(true.mass / mine.mass - 1.0) <= 2.0 * tolerance.inertia
            assert abs(true.coulomb / mine.coulomb - 1.0) <= 2.0 * tolerance.friction
            assert abs(true.rotor_inertia / mine.rotor_inertia - 1.0) <= 2.0 * tolerance.rotor_inertia


def test_a_trusted_robot_is_its_model(rng):
    table = draw_table(rng, "planar2")
    assert perturbed(rng, table, TRUSTED) == table


def measured_setup(seed, robot):
    setup = draw_setup(seed, robot=robot)
    without = run_of(setup, None)
    return setup, without, ruler(setup.owner, setup.truth, setup.tolerance, setup.session, without)


def test_a_move_inside_the_tolerance_leaves_nothing_beyond_it():
    """Known truth: half a tolerance of the modelled viscous friction, from a model that was right."""
    setup = draw_setup(11, robot="planar2")
    setup = replace(setup, truth=setup.owner)
    measure = ruler(setup.owner, setup.owner, setup.tolerance, setup.session, run_of(setup, None))
    effect = Effect("viscous_friction", 0, {"coefficient": 0.025 * setup.owner.links[0].viscous})
    assert measure.beyond_tolerance(effect) < 0.02 * measure.size(effect)


def test_the_paired_run_confirms_the_size_of_the_effect():
    setup, without, measure = measured_setup(12, "planar2")
    effect = sized(Recipe("viscous_friction", 1, {}), measure, 6.0)
    assert effect is not None
    gap = paired_gap(run_of(setup, effect), without, setup.truth, setup.session, measure.floor)
    assert gap[1] == pytest.approx(6.0, rel=0.1)


def test_the_noise_floor_is_what_a_perfect_model_leaves():
    """Known truth: the log against the true robot and its friction, by Pinocchio, leaves one noise floor."""
    setup, without, measure = measured_setup(13, "planar2")
    rate, q = setup.session.rate, without.measured
    v = np.gradient(q, 1.0 / rate, axis=0)
    acceleration = np.zeros_like(q)
    acceleration[1:-1] = (q[2:] - 2.0 * q[1:-1] + q[:-2]) * rate**2
    needed = pinocchio_torque(pinocchio_model(setup.truth), q, v, acceleration)
    true_v = midpoint_motion(without)[1]
    left = banded(logged_torque(without, "instant") - needed - friction_torque(setup.truth, true_v), rate)
    np.testing.assert_allclose(rms(left) / measure.floor, 1.0, atol=0.15)


def names_of(entries):
    return [(one["effect"], one["joint"]) for one in entries]


def test_a_link_that_changes_as_a_payload_would_is_alike_to_a_payload():
    """Known truth: a heavier last link of a pendulum, whose three visible numbers a point mass can all reach."""
    _, _, measure = measured_setup(11, "pendulum")
    factors = {"mass_factor": 1.6, "center_factor": 1.0, "inertia_factor": 1.6}
    assert ("payload", None) in names_of(alike(Effect("inertial_parameters", 0, factors), measure))


def test_coulomb_friction_alone_is_alike_to_nothing():
    _, _, measure = measured_setup(11, "pendulum")
    assert alike(Effect("coulomb_friction", 0, {"torque": 0.3}), measure) == []


def test_direction_dependent_friction_with_equal_sides_is_alike_to_coulomb_friction():
    """Known truth: T+ = T- without viscous parts is Coulomb friction."""
    _, _, measure = measured_setup(11, "pendulum")
    names = ("torque_positive", "torque_negative", "coefficient_positive", "coefficient_negative")
    effect = Effect("direction_dependent_friction", 0, dict(zip(names, (0.2, 0.2, 0.0, 0.0), strict=True)))
    found = {one["effect"]: one["leaves"] for one in alike(effect, measure)}
    assert found["coulomb_friction"] < 1e-4  # precision of the bounded solver


def test_feedforward_of_a_resting_arm_is_its_weight(rng):
    table = draw_table(rng, "planar2")
    still = np.full((10, 2), 0.3)
    weight = pin.computeGeneralizedGravity(pinocchio_model(table), pinocchio_model(table).createData(), still[0])
    np.testing.assert_allclose(feedforward(table, still, 500.0)[5], weight, rtol=1e-6)


def test_an_effect_on_nothing_is_no_effect(rng):
    table = draw_table(rng, "pendulum")
    assert plant_with(None, table) == bare_plant(table)
