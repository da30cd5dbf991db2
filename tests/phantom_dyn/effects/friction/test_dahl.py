from __future__ import annotations

import numpy as np

from phantom_dyn.effects.friction.presliding_friction import dahl


def test_a_bristle_of_dahl_yields_as_an_exponential_after_a_reversal():
    # Closed form: from -1 on the way back by x it gives 1 - 2 exp(-x / d).
    d, way = 0.02, np.linspace(0.0, 0.1, 200)
    q = np.concatenate([np.linspace(1.0, 0.0, 50), way[1:]])
    np.testing.assert_allclose(dahl(q, d)[49:], 1.0 - 2.0 * np.exp(-way / d), atol=1e-12)


def test_from_rest_the_slope_of_a_bristle_of_dahl_is_one_over_its_displacement():
    # The contract's initial stiffness: torque / displacement.
    q = np.array([0.3, 0.3 + 1e-7])
    assert np.isclose(dahl(q, 0.02)[1] / 1e-7, 1.0 / 0.02, rtol=1e-4)


def test_a_bristle_of_dahl_follows_its_differential_equation(rng):
    # Oracle: one exact step after the other.
    q, d = np.cumsum(rng.normal(0.0, 0.01, 100)), 0.02
    z = [0.0]
    for step in np.diff(q):
        z.append(np.sign(step) + (z[-1] - np.sign(step)) * np.exp(-abs(step) / d))
    np.testing.assert_allclose(dahl(q, d), z, atol=1e-12)
