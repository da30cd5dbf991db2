"""Terms of a diagnosis: structure, known friction, operations."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from identification.data.signals import process_all
from identification.diagnosis.columns.operations import operation_of, with_expected_torque, with_known
from identification.diagnosis.columns.structure import STRUCTURES
from identification.diagnosis.columns.terms import FoundEffect, KnownEffect, merged, shapes_of, untestable_effects
from phantom_dyn.dynamics.dynamics import inverse_dynamics, rigid_body_regressor, standard_parameters
from phantom_dyn.effects.catalogue import EFFECTS, effect_named
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.support.changed_robot import with_parameters
from phantom_dyn.model.inertia import point_mass_parameters
from phantom_dyn.motion import Motion


@pytest.fixture(scope="module")
def operation(lab, planar2) -> Operation:
    return Operation.of(planar2, lab.motion(2))


def tried(robot, operation, found=()):
    return {(effect.name, joint): shapes for effect, joint, shapes in shapes_of(robot, operation, found)}


def stribeck_at(velocity: float, joint: str = "elbow") -> FoundEffect:
    return FoundEffect(effect_named("stribeck_friction"), joint, (velocity,), np.array([0.3, 0.6]))


def test_every_effect_and_structure_is_tried_wherever_it_can_be_seen(operation, planar2):
    every = {(effect.name, joint) for effect in (*EFFECTS, *STRUCTURES) for joint in effect.places(planar2)}
    hidden = {(effect, joint) for effect, joint, _ in untestable_effects(planar2, operation)}
    assert set(tried(planar2, operation)) == every - hidden


def test_what_a_torque_sensor_hides_is_not_tried_and_said_in_words(operation, planar2):
    sensed = replace(planar2, torque_source="sensor")
    hidden = {(effect, joint): why for effect, joint, why in untestable_effects(sensed, operation)}
    assert "sensor" in hidden["torque_constant", "elbow"]
    assert ("torque_constant", "elbow") not in tried(sensed, operation)


def test_a_law_that_is_linear_has_the_empty_shape_only(operation, planar2):
    assert tried(planar2, operation)["viscous_friction", "elbow"] == ((),)


def test_without_a_fit_the_shapes_are_those_to_start_from(operation, planar2):
    stribeck = effect_named("stribeck_friction")
    assert tried(planar2, operation)["stribeck_friction", "elbow"] == stribeck.shapes(planar2, operation, "elbow")


def test_about_a_fit_the_shape_that_was_found_and_nearer_ones_are_tried(operation, planar2):
    start = [s[0] for s in tried(planar2, operation)["stribeck_friction", "elbow"]]
    again = [s[0] for s in tried(planar2, operation, (stribeck_at(0.2),))["stribeck_friction", "elbow"]]
    assert any(np.isclose(velocity, 0.2) for velocity in again)
    assert min(again) < 0.2 < max(again)
    assert max(again) / min(again) < max(start) / min(start)


def test_of_a_law_whose_special_case_was_found_the_whole_grid_is_tried_too(operation, planar2):
    # What the recording hardly shows is not excluded: see `odds_of_richer_laws`.
    coulomb = FoundEffect(effect_named("coulomb_friction"), "elbow", (), np.array([0.3]))
    start = tried(planar2, operation)["stribeck_friction", "elbow"]
    again = tried(planar2, operation, (coulomb, stribeck_at(0.2)))["stribeck_friction", "elbow"]
    assert set(start) < set(again)


def test_a_fit_on_one_joint_leaves_the_shapes_of_the_other(operation, planar2):
    before, after = tried(planar2, operation), tried(planar2, operation, (stribeck_at(0.2),))
    assert after["stribeck_friction", "shoulder"] == before["stribeck_friction", "shoulder"]


def test_what_an_experiment_of_its_own_shows_stands_beside_the_grid(operation, planar2):
    before = tried(planar2, operation)["stribeck_friction", "elbow"]
    seen = {(e.name, j): shapes for e, j, shapes in shapes_of(planar2, operation, (), (stribeck_at(0.2),))}
    assert seen["stribeck_friction", "elbow"] == (*before, (0.2,))


def test_a_delay_is_taken_again_about_its_last_estimate(operation, planar2):
    found = FoundEffect(effect_named("input_delay"), None, (0.002,), np.array([0.0043]))
    assert tried(planar2, operation, (found,))["input_delay", None] == ((0.0043,),)


@pytest.fixture(scope="module")
def steady(planar2) -> Operation:
    """The arm stretched out to one side: its weight hardly changes while it moves a little."""
    t = np.arange(2000) / 200.0
    q = np.column_stack([0.5 * np.pi + 0.02 * np.sin(2.0 * t), 0.02 * np.cos(3.0 * t)])
    return Operation.of(planar2, Motion(t, q, np.gradient(q, t, axis=0), 0 * q))


@pytest.mark.parametrize(("name", "other"), [("cogging", "torque_ripple"), ("torque_ripple", "cogging")])
def test_waves_of_an_order_that_was_found_are_tried_with_and_without_a_steady_load(
    steady, operation, planar2, name, other
):
    # A load that hardly changes does not separate them: neither is certain before the other was tried.
    found = FoundEffect(effect_named(name), "elbow", (37.0,), np.array([0.1, 0.0]))
    assert (37.0,) not in tried(planar2, steady).get((other, "elbow"), ())
    again = tried(planar2, steady, (found,))
    assert (37.0,) in again[other, "elbow"]
    assert (37.0,) not in again.get((other, "shoulder"), ())
    # A load of both signs separates them.
    assert (37.0,) not in tried(planar2, operation, (found,))[other, "elbow"]


def test_a_structure_has_no_name_in_the_catalogue(quiet):
    assert not quiet.term("drifting_friction", "elbow").named
    assert quiet.term("coulomb_friction", "elbow").named


def test_a_shape_that_is_an_estimate_is_no_further_parameter(quiet):
    # A delay has one parameter; friction with a Stribeck velocity has three.
    assert quiet.term("input_delay", None).size == 1
    assert quiet.term("stribeck_friction", "elbow").size == 3


def test_operations_follow_each_other_in_time(lab, planar2):
    parts = tuple(Operation.of(planar2, lab.motion(2, seed, seconds=seconds)) for seed, seconds in ((0, 4.0), (1, 2.0)))
    whole = merged(parts)
    for name in ("q", "v", "a", "tau", "expected", "logged"):
        np.testing.assert_array_equal(getattr(whole, name), np.concatenate([getattr(part, name) for part in parts]))
    np.testing.assert_allclose(np.diff(whole.t), 0.005)


def test_one_operation_is_itself(operation):
    assert merged((operation,)) is operation


RUBS = KnownEffect("load_dependent_friction", "elbow", (0.3,))

LOAD = KnownEffect("payload", None, (0.4, 0.0, 0.0, -0.3))


@pytest.fixture
def moving(lab, planar2):
    return Operation.of(planar2, lab.motion(2))


def test_what_a_load_asks_of_the_drive_holds_its_friction(planar2, moving):
    # The model with both at once, less the model with the friction alone; samples near a change of the load's sign,
    # where the law has a kink, are left out.
    alone, both = (with_known(planar2, moving, known) for known in ((RUBS,), (LOAD, RUBS)))
    assert alone.per_load is not None
    added = np.zeros(10 * (planar2.model.njoints - 1))
    mass, center = LOAD.theta[0], np.array(LOAD.theta[1:])
    inertia = mass * (center @ center * np.eye(3) - np.outer(center, center))
    added[-10:] = [mass, *(mass * center), inertia[0, 0], inertia[0, 1], inertia[1, 1], inertia[0, 2], inertia[1, 2],
                   inertia[2, 2]]  # fmt: skip
    asked = alone.per_load * (rigid_body_regressor(planar2, moving) @ added)
    bare, loaded = moving.transmitted[:, 1], with_known(planar2, moving, (LOAD,)).tau[:, 1]
    same = (np.sign(bare) == np.sign(loaded)) & (np.abs(bare) > 0.05 * np.abs(bare).max())
    assert same.mean() > 0.5
    np.testing.assert_allclose(asked[same, 1], (both.tau - alone.tau)[same, 1], rtol=1e-3, atol=1e-3)


def test_only_the_joint_that_rubs_asks_for_more(planar2, moving):
    found = with_known(planar2, moving, (RUBS,)).per_load
    assert found is not None
    assert np.all(found[:, 0] == 1.0)
    np.testing.assert_allclose(np.unique(np.round(np.abs(found[:, 1] - 1.0), 3))[-1], 0.3)


def test_friction_that_no_load_changes_asks_for_no_more(planar2, moving):
    assert with_known(planar2, moving, (KnownEffect("coulomb_friction", "elbow", (0.3,)),)).per_load is None


PAYLOAD = (0.8, 0.1, -0.02, 0.3)  # kg, m


@pytest.fixture(scope="module")
def heavier(planar):
    """The arm with a point mass on its last link."""
    added = np.zeros_like(standard_parameters(planar))
    added[10:] = point_mass_parameters(PAYLOAD[0], np.array(PAYLOAD[1:]))
    return with_parameters(planar, added)


def test_the_transmissions_pass_what_a_payload_needs_and_not_what_a_rotor_needs(lab, planar, heavier):
    operation = Operation.of(planar, lab.motion(2))
    payload = FoundEffect(effect_named("payload"), None, (), point_mass_parameters(PAYLOAD[0], np.array(PAYLOAD[1:])))
    rotor = FoundEffect(effect_named("rotor_inertia"), "elbow", (), np.array([0.2]))
    model = heavier.model.copy()
    model.armature = np.zeros(2)
    smooth = replace(heavier, model=model, viscous_friction=np.zeros(2), coulomb_friction=np.zeros(2))
    expected = inverse_dynamics(smooth, operation)
    np.testing.assert_allclose(with_expected_torque(operation, (payload, rotor)).load, expected, atol=1e-9)


def test_what_was_found_of_the_load_is_not_counted_twice(lab, planar):
    operation = Operation.of(planar, lab.motion(2))
    spring = FoundEffect(effect_named("parasitic_spring"), "elbow", (), np.array([2.0, 0.3]))
    once = with_expected_torque(operation, (spring,))
    np.testing.assert_allclose(with_expected_torque(once, (spring,)).load, once.load, atol=1e-12)


def test_friction_that_was_found_is_no_load(lab, planar):
    operation = Operation.of(planar, lab.motion(2))
    rubs = FoundEffect(effect_named("coulomb_friction"), "elbow", (), np.array([0.5]))
    np.testing.assert_array_equal(with_expected_torque(operation, (rubs,)).load, operation.transmitted)


def test_known_friction_under_load_and_torque_constants_are_those_of_the_robot_with_its_known_payload(
    lab, planar, heavier
):
    (log,), _ = process_all((lab.recording(planar, lab.motion(2)),), planar)
    known = (
        KnownEffect("torque_constant", "elbow", (0.8,)),
        KnownEffect("load_dependent_friction", "elbow", (0.2,)),
        KnownEffect("payload", None, PAYLOAD),
    )
    needed = inverse_dynamics(heavier, log.motion)
    model = heavier.model.copy()
    model.armature = np.zeros(2)
    smooth = replace(heavier, model=model, viscous_friction=np.zeros(2), coulomb_friction=np.zeros(2))
    load = inverse_dynamics(smooth, log.motion)[:, 1]
    needed[:, 1] = (needed[:, 1] + 0.2 * np.abs(load) * np.sign(log.motion.v[:, 1])) / 0.8
    np.testing.assert_allclose(operation_of(planar, log, known).tau, needed, atol=1e-9)


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
    known = (KnownEffect("payload", None, PAYLOAD), *displacing)
    np.testing.assert_allclose(operation_of(planar, log, known).tau, wanted, atol=1e-9)
