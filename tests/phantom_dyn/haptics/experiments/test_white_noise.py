"""Simulated white-noise experiments: against the recursion of the sampled device by SciPy."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from phantom_dyn.haptics.device.axis import RigidAxis
from phantom_dyn.haptics.experiments.white_noise import simulate_white_noise

T = 1e-3


def test_positions_are_those_of_the_difference_equation(rng):
    # Closed form without damping: y = (T^2/2m) (1 + 1/z) / (1 - 1/z)^2 u / z.
    found = simulate_white_noise(
        RigidAxis(2.0, 0.0), period=T, delay=3 * T, force=1.0, position_noise=0.0, duration=0.5, rng=rng
    )
    late = np.concatenate([np.zeros(3), found.force[:-3]])
    expected = lfilter(T**2 / 4.0 * np.array([0.0, 1.0, 1.0]), [1.0, -2.0, 1.0], late)
    np.testing.assert_allclose(found.position, expected, rtol=1e-6, atol=1e-12)


def test_force_and_noise_have_the_asked_sizes(rng):
    found = simulate_white_noise(RigidAxis(1e9, 0.0), period=T, force=3.0, position_noise=0.5, duration=20.0, rng=rng)
    np.testing.assert_allclose([np.std(found.force), np.std(found.position)], [3.0, 0.5], rtol=0.03)


def test_the_same_generator_gives_the_same_experiment():
    draws = [
        simulate_white_noise(
            RigidAxis(1.0, 1.0), period=T, force=1.0, position_noise=1.0, duration=0.1, rng=np.random.default_rng(3)
        ).position
        for _ in range(2)
    ]
    np.testing.assert_array_equal(*draws)
