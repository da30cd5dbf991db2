from __future__ import annotations

import numpy as np

from phantom_dyn.walking.pattern import foot_motion


def test_velocity_and_acceleration_of_a_sole_are_the_derivatives_of_its_position(reference):
    # Oracle: central differences.
    step = 1e-5
    t = np.arange(1.0005, 6.0, 0.013)  # no sample at a lift-off or landing, where the third derivative jumps
    before, here, after = (foot_motion(reference.phases, t + k * step, "left", 0.04) for k in (-1, 0, 1))
    np.testing.assert_allclose((after.position - before.position) / (2 * step), here.velocity, atol=1e-8)
    np.testing.assert_allclose((after.velocity - before.velocity) / (2 * step), here.acceleration, atol=1e-6)


def test_a_sole_on_the_ground_does_not_move(reference):
    for foot in (reference.left, reference.right):
        np.testing.assert_array_equal(foot.position[foot.contact, 2], 0.0)
        np.testing.assert_allclose(foot.velocity[foot.contact], 0.0, atol=1e-12)


def test_a_swinging_sole_rises_to_the_step_height(reference):
    assert abs(reference.left.position[:, 2].max() - reference.gait.step_height) < 1e-12


def test_one_foot_is_always_on_the_ground(reference):
    assert (reference.left.contact | reference.right.contact).all()


def test_a_sole_comes_down_where_the_plan_says(reference):
    last = reference.phases[-1].landing
    np.testing.assert_allclose(reference.left.position[-1], [last.left.x, last.left.y, 0, last.left.heading])
    np.testing.assert_allclose(reference.right.position[-1], [last.right.x, last.right.y, 0, last.right.heading])
