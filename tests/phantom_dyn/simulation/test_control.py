"""Control. Oracles: the PHANToM's closed forms, and the exponential that the error must follow."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from phantom_dyn import load_robot
from phantom_dyn.devices import phantom as closed
from phantom_dyn.errors import ParameterError
from phantom_dyn.motion import Motion
from phantom_dyn.simulation.control import computed_torque, gravity_compensation


@pytest.fixture(scope="module")
def robot():
    return load_robot("phantom_1_5")


def reference(t):
    """A smooth motion of three joints at a time."""
    w, size = np.array([3.0, 5.0, 4.0]), np.array([0.4, 0.3, 0.2])
    phase = np.outer(np.atleast_1d(t), w)
    return Motion(np.atleast_1d(t), size * np.sin(phase), size * w * np.cos(phase), -size * w**2 * np.sin(phase))


def test_gravity_compensation_is_the_published_gravity_torque(robot, rng):
    q = rng.uniform(-1, 1, (50, 3))
    np.testing.assert_allclose(gravity_compensation(robot, q), closed.gravity_torque(q), rtol=0, atol=1e-15)


def test_under_computed_torque_the_error_of_the_published_dynamics_is_critically_damped(robot):
    # Closed form: e = e0 (1 + w t) exp(-w t) from rest, for kp = w^2 and kd = 2 w.
    w, start = 20.0, np.array([0.1, -0.2, 0.15])
    gains = {"kp": np.full(3, w**2), "kd": np.full(3, 2 * w)}

    def rate(t, x):
        q, v = x[None, :3], x[None, 3:]
        tau = computed_torque(robot, reference(t), q, v, **gains)
        bias = np.einsum("nij,nj->ni", closed.coriolis_matrix(q, v), v) + closed.gravity_torque(q)
        return np.concatenate([v[0], np.linalg.solve(closed.mass_matrix(q)[0], (tau - bias)[0])])

    begin = reference(0.0)
    t = np.linspace(0, 0.3, 7)
    x = solve_ivp(rate, (0, 0.3), [*(begin.q[0] - start), *begin.v[0]], t_eval=t, rtol=1e-9, atol=1e-11).y.T
    error = reference(t).q - x[:, :3]
    expected = start * ((1 + w * t) * np.exp(-w * t))[:, None]
    np.testing.assert_allclose(error, expected, rtol=0, atol=1e-7)


def test_computed_torque_refuses_a_negative_gain(robot):
    rest = reference(np.zeros(1))
    with pytest.raises(ParameterError, match="The gains kd are"):
        computed_torque(robot, rest, rest.q, rest.v, kp=np.ones(3), kd=-np.ones(3))
