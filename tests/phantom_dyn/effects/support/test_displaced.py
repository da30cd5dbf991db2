from __future__ import annotations

import numpy as np
import pytest

from phantom_dyn.dynamics.dynamics import inverse_dynamics, link_torque
from phantom_dyn.effects.catalogue import EFFECTS, effect_named
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.support.displaced import (
    change_by_link,
    change_by_reading,
    displaced,
    exact_change_by_link,
    exact_change_by_reading,
    link_load,
)
from phantom_dyn.motion import Motion

STEP = 1e-6


@pytest.fixture
def moving(planar, rng):
    q, v, a = rng.uniform(-1.5, 1.5, (3, 30, 2))
    return Operation.of(planar, Motion(np.arange(30.0), q, v, a))


@pytest.fixture
def shifts(rng):
    return rng.normal(size=(3, 30))


def slope(torque, robot, motion, shifts):
    """Central finite difference of a torque along a shift of the elbow."""
    ends = [torque(robot, displaced(motion, 1, *(sign * STEP * shifts))) for sign in (-1.0, 1.0)]
    return (ends[1] - ends[0]) / (2 * STEP)


def test_a_reading_moves_rotor_friction_and_link(planar, moving, shifts):
    expected = slope(inverse_dynamics, planar, moving, shifts)
    np.testing.assert_allclose(change_by_reading(moving, 1, *shifts), expected, atol=1e-6)


def test_a_link_moves_without_rotor_and_friction(planar, moving, shifts):
    expected = slope(link_torque, planar, moving, shifts)
    np.testing.assert_allclose(change_by_link(moving, 1, *shifts), expected, atol=1e-6)


@pytest.mark.parametrize(
    ("exact", "first_order"), [(exact_change_by_link, change_by_link), (exact_change_by_reading, change_by_reading)]
)
def test_the_exact_change_is_that_of_first_order_for_small_shifts(planar, moving, shifts, exact, first_order):
    change = exact(planar, moving, 1, *(STEP * shifts)) / STEP
    np.testing.assert_allclose(change, first_order(moving, 1, *shifts), atol=1e-4)


def test_the_load_of_a_link_is_the_torque_without_rotor_and_friction(planar, moving):
    np.testing.assert_allclose(link_load(moving, 1), link_torque(planar, moving)[:, 1], atol=1e-10)


@pytest.mark.parametrize(
    ("name", "joint", "theta"),
    [
        ("encoder_offset", "tilt", [0.3]),
        ("encoder_eccentricity", "tilt", [0.05, 0.4, 1.0]),
        ("base_tilt", None, [0.2, -0.1, 0.0]),
    ],
)
def test_what_displaces_links_changes_the_torque_by_that_of_the_true_motion(arm, smooth, name, joint, theta):
    # Oracle: inverse dynamics, of the readings by the model and of the true motion in the true gravity.
    effect, theta = effect_named(name), np.array(theta)
    there = inverse_dynamics(*effect.true_motion(arm, smooth, joint, theta))
    expected = there - inverse_dynamics(arm, smooth)
    np.testing.assert_allclose(effect.torque(arm, smooth, joint, theta), -expected, atol=1e-9)
    assert np.abs(expected).max() > 0.01
    assert effect.displaces


@pytest.mark.parametrize(
    "effect", [effect for effect in EFFECTS if not effect.displaces], ids=lambda effect: effect.name
)
def test_other_effects_leave_the_links_where_they_are_read(arm, smooth, effect):
    assert effect.true_motion(arm, smooth, None, np.zeros(1)) == (arm, smooth)
