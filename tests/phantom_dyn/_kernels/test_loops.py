"""Compiled loops over samples against NumPy and SciPy."""

import numpy as np
import pytest
from scipy.signal import firwin, oaconvolve

from phantom_dyn._kernels.dry_friction import Rubbing, rub, rubbing_motors
from phantom_dyn._kernels.fir import filtered


def test_friction_stops_what_it_can_and_slips_with_its_limit_where_it_cannot(rng):
    # The conditions of Coulomb friction: |friction| <= limit; at rest below it; against the motion at it.
    for _ in range(20):
        half = rng.normal(size=(4, 4))
        mobility, free, most, h = half @ half.T + 0.5 * np.eye(4), rng.normal(size=4), rng.uniform(0.0, 80.0, 4), 1e-2
        speed, friction = free.copy(), rng.uniform(-1.0, 1.0, 4) * most
        rub(mobility, speed, rubbing_motors(np.arange(4), 4), friction, most, h)
        np.testing.assert_allclose(speed, free + mobility @ friction * h, atol=1e-7)
        sticks = np.abs(friction) < most
        assert np.all(speed[sticks] == 0.0)
        np.testing.assert_allclose(friction[~sticks], -np.sign(speed[~sticks]) * most[~sticks])


def test_without_friction_no_speed_changes(rng):
    speed = rng.normal(size=3)
    same = speed.copy()
    rub(np.eye(3), speed, rubbing_motors(np.arange(3), 3), np.zeros(3), np.zeros(3), 1e-3)
    np.testing.assert_array_equal(speed, same)


def test_a_passive_joint_rubs_as_a_motor_with_its_own_velocity_would(rng):
    # The same conditions in the velocities of all that rubs: two motors, and a joint that turns with both.
    turns = np.array([[1.0, 0.0], [0.0, 1.0], [0.7, -1.2]])
    for _ in range(20):
        half = rng.normal(size=(2, 2))
        mobility, free, most, h = half @ half.T + 0.5 * np.eye(2), rng.normal(size=2), rng.uniform(0.0, 60.0, 3), 1e-2
        speed, friction = free.copy(), np.zeros(3)
        rub(mobility, speed, Rubbing(np.arange(2), turns[2:], np.zeros((1, 3))), friction, most, h)
        np.testing.assert_allclose(speed, free + mobility @ turns.T @ friction * h, atol=1e-7)
        rates = turns @ speed
        moves = np.abs(rates) > 1e-6
        assert np.all(np.abs(friction) <= most)
        np.testing.assert_allclose(friction[moves], -np.sign(rates[moves]) * most[moves])


KERNEL = np.array(firwin(31, 0.2), dtype=float)


@pytest.mark.parametrize("step", [1, 3, 7])
def test_samples_that_are_kept_are_those_of_a_whole_convolution(step):
    rng = np.random.default_rng(4)
    x, kernel = rng.normal(size=(200, 3)), KERNEL
    whole = np.array(oaconvolve(x, kernel[:, None], mode="valid", axes=0))
    np.testing.assert_allclose(filtered(kernel, x, step), whole[::step], atol=1e-14)


def test_a_record_shorter_than_the_kernel_has_no_sample_inside():
    assert filtered(KERNEL, np.ones((30, 2)), 2).shape == (0, 2)


@pytest.mark.parametrize("step", [1, 4])
def test_a_column_does_not_depend_on_its_neighbours(step):
    # Oracle: the column alone, to the last digit; a product of all columns rounds by how many there are.
    x = np.random.default_rng(5).normal(size=(1000, 7))
    together = filtered(KERNEL, x, step)
    for column in range(7):
        np.testing.assert_array_equal(together[:, column], filtered(KERNEL, x[:, [column]], step)[:, 0])
