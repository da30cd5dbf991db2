# pyright: reportAttributeAccessIssue=false
"""What effects are made of once others are found or known. Oracle: Pinocchio with the changed robot."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from identification.data.signals import process_all
from identification.diagnosis.columns.operations import expecting, operate
from identification.diagnosis.columns.terms import FoundEffect, KnownEffect
from phantom_dyn.dynamics.dynamics import inverse_dynamics, standard_parameters
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.support.changed_robot import with_parameters
from phantom_dyn.model.inertia import point_mass_parameters

LOAD = (0.8, 0.1, -0.02, 0.3)  # kg, m


@pytest.fixture(scope="module")
def heavier(planar):
    """The arm with a point mass on its last link."""
    added = np.zeros_like(standard_parameters(planar))
    added[10:] = point_mass_parameters(LOAD[0], np.array(LOAD[1:]))
    return with_parameters(planar, added)


def test_the_transmissions_pass_what_a_payload_needs_and_not_what_a_rotor_needs(lab, planar, heavier):
    operation = Operation.of(planar, lab.motion(2))
    payload = FoundEffect(effect_named("payload"), None, (), point_mass_parameters(LOAD[0], np.array(LOAD[1:])))
    rotor = FoundEffect(effect_named("rotor_inertia"), "elbow", (), np.array([0.2]))
    model = heavier.model.copy()
    model.armature = np.zeros(2)
    expected = inverse_dynamics(replace(heavier, model=model), operation)
    np.testing.assert_allclose(expecting(planar, operation, (payload, rotor)).load, expected, atol=1e-9)


def test_what_was_found_of_the_load_is_not_counted_twice(lab, planar):
    operation = Operation.of(planar, lab.motion(2))
    spring = FoundEffect(effect_named("parasitic_spring"), "elbow", (), np.array([2.0, 0.3]))
    once = expecting(planar, operation, (spring,))
    np.testing.assert_allclose(expecting(planar, once, (spring,)).load, once.load, atol=1e-12)


def test_friction_that_was_found_is_no_load(lab, planar):
    operation = Operation.of(planar, lab.motion(2))
    rubs = FoundEffect(effect_named("coulomb_friction"), "elbow", (), np.array([0.5]))
    np.testing.assert_array_equal(expecting(planar, operation, (rubs,)).load, operation.transmitted)


def test_known_friction_under_load_and_torque_constants_are_those_of_the_robot_with_its_known_payload(
    lab, planar, heavier
):
    (log,), _ = process_all((lab.recording(planar, lab.motion(2)),), planar)
    known = (
        KnownEffect("torque_constant", "elbow", (0.8,)),
        KnownEffect("load_dependent_friction", "elbow", (0.2,)),
        KnownEffect("payload", None, LOAD),
    )
    needed = inverse_dynamics(heavier, log.motion)
    load = needed[:, 1] - planar.rotor_inertia[1] * log.motion.a[:, 1]
    needed[:, 1] = (needed[:, 1] + 0.2 * np.abs(load) * np.sign(log.motion.v[:, 1])) / 0.8
    np.testing.assert_allclose(operate(planar, log, known).tau, needed, atol=1e-9)


TURNED = (0.05, -0.08, 0.0)  # rad, across the gravity of an arm that hangs along z


@pytest.mark.parametrize(
    "displacing",
    [
        (KnownEffect("encoder_offset", "elbow", (0.1,)),),
        (KnownEffect("base_tilt", None, TURNED),),
        (KnownEffect("encoder_offset", "elbow", (0.1,)), KnownEffect("base_tilt", None, TURNED)),
        (KnownEffect("encoder_offset", "elbow", (0.1,)), KnownEffect("encoder_offset", "shoulder", (-0.2,))),
    ],
)
def test_a_known_payload_is_where_the_links_truly_are(displacing, lab, planar, heavier):
    # Oracle: Pinocchio with the loaded robot at its true positions, in the gravity that it truly feels.
    (log,), _ = process_all((lab.recording(planar, lab.motion(2)),), planar)
    offsets = {one.joint: one.theta[0] for one in displacing if one.effect == "encoder_offset"}
    q = log.motion.q - [offsets.get(joint, 0.0) for joint in planar.joint_names]
    model = heavier.model.copy()
    if any(one.effect == "base_tilt" for one in displacing):
        model.gravity = pin.Motion(pin.exp3(np.array(TURNED)) @ model.gravity.linear, np.zeros(3))
    wanted = inverse_dynamics(replace(heavier, model=model), replace(log.motion, q=q))
    known = (KnownEffect("payload", None, LOAD), *displacing)
    np.testing.assert_allclose(operate(planar, log, known).tau, wanted, atol=1e-9)
