from __future__ import annotations

import numpy as np
import pytest

from identification.excitation.motion_shapes import Sine, Triangle, wave_motion
from phantom_dyn.errors import ParameterError

WAVES = [Sine(0.4, 0.7, 0.2), Triangle(0.4, 0.7, 0.2), Triangle(0.4, 0.7, turn=0.5)]


@pytest.mark.parametrize("wave", WAVES, ids=repr)
def test_velocity_and_acceleration_are_the_slopes(wave):
    # Oracle: central differences.
    t, h = np.linspace(0, 5, 3001), 1e-6
    _, v, a = wave.motion(t)
    before, after = wave.motion(t - h), wave.motion(t + h)
    np.testing.assert_allclose(v, (after[0] - before[0]) / (2 * h), atol=1e-8)
    # The slope of the acceleration jumps at the ends of a turn.
    np.testing.assert_allclose(a, (after[1] - before[1]) / (2 * h), atol=1e-3)


@pytest.mark.parametrize("wave", WAVES, ids=repr)
def test_a_wave_swings_between_plus_and_minus_its_amplitude(wave):
    q = wave.motion(np.linspace(0, 1 / 0.7, 20001))[0]
    assert q.max() == pytest.approx(0.4, rel=1e-6)
    assert q.min() == pytest.approx(-0.4, rel=1e-6)


@pytest.mark.parametrize("wave", WAVES, ids=repr)
def test_a_wave_repeats_after_its_period(wave):
    t = np.linspace(0, 1, 501)
    np.testing.assert_allclose(wave.motion(t + 10 / 0.7), wave.motion(t), atol=1e-11)


def test_a_triangle_holds_its_speed_but_in_the_turns():
    t = np.linspace(0, 10, 100000, endpoint=False)
    wave = Triangle(0.3, 0.5, turn=0.1)
    straight = wave.motion(t)[2] == 0
    np.testing.assert_allclose(np.abs(wave.motion(t)[1][straight]), wave.speed)
    # Closed form: two turns of a tenth of the period.
    assert straight.mean() == pytest.approx(0.8, abs=1e-3)


def test_a_sharp_triangle_has_the_speed_of_its_way():
    # Closed form: four amplitudes a period.
    assert Triangle(0.3, 0.5, turn=1e-9).speed == pytest.approx(4 * 0.3 * 0.5)


def test_a_triangle_that_only_turns_is_a_sine():
    t = np.linspace(0, 5, 500)
    np.testing.assert_allclose(Triangle(0.3, 0.5, 0.1, turn=0.5).motion(t), Sine(0.3, 0.5, 0.1).motion(t), atol=1e-12)


def test_waves_of_a_joint_add_up_about_its_center():
    t = np.linspace(0, 3, 50)
    motion = wave_motion(t, [WAVES[:2], []], np.array([1.0, -2.0]))
    first, second = WAVES[0].motion(t), WAVES[1].motion(t)
    np.testing.assert_allclose(motion.q, np.stack([1 + first[0] + second[0], np.full(50, -2.0)], axis=1))
    np.testing.assert_allclose(motion.v, np.stack([first[1] + second[1], np.zeros(50)], axis=1))
    np.testing.assert_allclose(motion.a, np.stack([first[2] + second[2], np.zeros(50)], axis=1))


@pytest.mark.parametrize("turn", [0.0, 0.6, np.nan])
def test_a_turn_that_does_not_fit_the_period_is_refused(turn):
    with pytest.raises(ParameterError, match=r"of its period: give more than 0 and at most 0\.5"):
        Triangle(0.3, 0.5, turn=turn)


@pytest.mark.parametrize("wave", [Sine, Triangle])
def test_a_frequency_of_zero_is_refused(wave):
    with pytest.raises(ParameterError, match="a frequency of 0 Hz was asked for: give more than 0"):
        wave(0.3, 0.0)
