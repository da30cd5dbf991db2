"""Rivals: which effects, places and shapes are tried in a recording."""

from dataclasses import replace

import numpy as np
import pytest

from identification.diagnosis.columns.structure import STRUCTURES
from identification.diagnosis.columns.terms import FoundEffect, merged, shapes_of, untestable_places
from phantom_dyn.effects.catalogue import EFFECTS, effect_named
from phantom_dyn.effects.operation import Operation


@pytest.fixture(scope="module")
def operation(lab, planar2) -> Operation:
    return Operation.of(planar2, lab.motion(2))


def tried(robot, operation, found=()):
    return {(effect.name, joint): shapes for effect, joint, shapes in shapes_of(robot, operation, found)}


def stribeck_at(velocity: float, joint: str = "elbow") -> FoundEffect:
    return FoundEffect(effect_named("stribeck_friction"), joint, (velocity,), np.array([0.3, 0.6]))


def test_every_effect_and_structure_is_tried_wherever_it_can_be_seen(operation, planar2):
    every = {(effect.name, joint) for effect in (*EFFECTS, *STRUCTURES) for joint in effect.places(planar2)}
    hidden = {(effect, joint) for effect, joint, _ in untestable_places(planar2, operation)}
    assert set(tried(planar2, operation)) == every - hidden


def test_what_a_torque_sensor_hides_is_not_tried_and_said_in_words(operation, planar2):
    sensed = replace(planar2, torque_source="sensor")
    hidden = {(effect, joint): why for effect, joint, why in untestable_places(sensed, operation)}
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
