"""Effects on the moving robots of the sealed cases against the contract's laws and Pinocchio."""

# pyright: reportAttributeAccessIssue=false
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from moved_robots import (
    friction_torque,
    kept,
    missing_torque,
    motion_of,
    pinocchio_model,
    pinocchio_torque,
    short_setup,
)

from benchmarks.gapbench.generator.effects import Effect
from benchmarks.gapbench.generator.plant import Outside
from benchmarks.gapbench.generator.setup import run_of
from benchmarks.gapbench.generator.sizing import at_samples, rms

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


@pytest.mark.parametrize(("name", "joint"), [*((name, 1) for name in LAWS), ("coulomb_friction", 0)])
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


def test_a_tilted_base_turns_gravity_about_the_axis_that_its_angles_make():
    """Pinocchio with gravity turned by its own exponential map."""
    setup = short_setup(9, "spatial3")
    run = run_of(setup, Effect("base_tilt", -1, {"roll": 0.2, "pitch": -0.1}))
    q, v, a = motion_of(run, setup.session.rate)
    gravity = pin.exp3(np.array([0.2, -0.1, 0.0])) @ np.array([0.0, 0.0, -9.81])
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
