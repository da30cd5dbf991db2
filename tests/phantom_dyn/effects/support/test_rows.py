"""Building blocks of the effects. Oracle: closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.support.rows import moving_average, never_reverses, secant, turning_points
from phantom_dyn.motion import Motion


@pytest.mark.parametrize(("seconds", "samples"), [(0.01, 5), (0.004, 3), (0.02, 11), (0.001, 1)])
def test_a_moving_average_takes_an_odd_number_of_samples_about_each(seconds, samples):
    # Closed form at 2 ms: an impulse is spread evenly over the window.
    impulse = np.zeros(41)
    impulse[20] = 1.0
    expected = np.where(np.abs(np.arange(41) - 20) <= samples // 2, 1.0 / samples, 0.0)
    np.testing.assert_allclose(moving_average(impulse, 0.002, seconds), expected, atol=1e-15)


def swinging(arm, v: np.ndarray) -> Operation:
    states = np.zeros((3, len(v), 3))
    states[1, :, 1] = v
    return Operation.of(arm, Motion(np.arange(len(v)) / 100.0, *states))


def test_a_joint_turns_where_its_speed_has_reversed(arm):
    # Closed form: cos(x) has reversed once |cos| is beyond a fiftieth of the top again, behind pi/2 and 3 pi/2.
    x = np.arange(0.0, 2.0 * np.pi, 0.01)
    v = np.cos(x)
    expected = [np.flatnonzero((x > k * np.pi) & (np.abs(v) > 0.02))[0] for k in (0.5, 1.5)]
    np.testing.assert_array_equal(turning_points(swinging(arm, v), 1), expected)


def test_a_speed_that_trembles_about_zero_turns_nowhere(arm):
    # Speeds below a fiftieth of the top one count as none.
    v = np.concatenate([np.ones(50), 0.01 * np.tile([1.0, -1.0], 25), np.ones(50)])
    assert len(turning_points(swinging(arm, v), 1)) == 0


def test_the_next_shape_of_a_law_is_its_estimate_unless_that_is_rounding():
    assert [secant(x, 1e-4) for x in (0.3, -0.3, 1e-5, -1e-5)] == [((0.3,),), ((-0.3,),), ((1e-4,),), ((1e-4,),)]


def test_an_estimate_at_the_least_is_taken_as_it_is():
    assert secant(1e-4, 1e-4) == ((1e-4,),)


@pytest.mark.parametrize(("dt", "samples"), [(0.0, 7), (0.002, 3), (1.0, 7)])
def test_a_moving_average_of_a_constant_is_that_constant(dt, samples):
    np.testing.assert_allclose(moving_average(np.full(samples, 2.5), dt, 0.01), 2.5)


def test_beyond_its_ends_a_moving_average_sees_the_last_samples():
    # By hand: three samples about each, the first and the last one twice.
    np.testing.assert_allclose(moving_average(np.array([0.0, 3.0, 6.0, 0.0]), 0.002, 0.004), [1.0, 3.0, 3.0, 2.0])


def test_a_joint_at_rest_never_reverses(arm):
    still = swinging(arm, 1e-10 * np.tile([1.0, -1.0], 40))
    assert never_reverses(arm, still, "tilt") == "tilt never reverses: its friction looks like a constant torque"


@pytest.mark.parametrize(("share", "turns"), [(0.019, 0), (0.021, 2)])
def test_a_speed_counts_from_a_fiftieth_of_the_top_speed_on(arm, share, turns):
    # By hand: forwards, slowly backwards, forwards; one in a hundred samples may be faster than the top.
    v = np.concatenate([np.ones(100), -share * np.ones(50), np.ones(100), [50.0]])
    assert len(turning_points(swinging(arm, v), 1)) == turns
