from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from phantom_dyn.walking.divergent_component import Profile, entry, forward_weights, holding_point, pendulum

OMEGA = 3.3
PROFILE = Profile(0.25, 0.8)
START, HOLD = np.array([0.1, -0.2]), np.array([0.3, 0.05])
XI, COM = np.array([0.15, -0.1]), np.array([0.12, -0.13])


def integrated(t):
    """Oracle: the pendulum by numerical integration."""

    def rate(time, state):
        p = START + (HOLD - START) * min(time / PROFILE.ramp, 1.0)
        return np.concatenate([state[2:], OMEGA**2 * (state[:2] - p)])

    begin = np.concatenate([COM, OMEGA * (XI - COM)])
    return solve_ivp(rate, (0, t[-1]), begin, t_eval=t, rtol=1e-11, atol=1e-12, max_step=0.01).y.T


def test_the_closed_form_is_the_integrated_pendulum():
    t = np.linspace(0, PROFILE.duration, 33)
    states, oracle = pendulum(t, PROFILE, (START, HOLD), XI, COM, OMEGA), integrated(t)
    np.testing.assert_allclose(states.com, oracle[:, :2], atol=1e-9)
    np.testing.assert_allclose(states.velocity, oracle[:, 2:], atol=1e-8)
    np.testing.assert_allclose(states.dcm, oracle[:, :2] + oracle[:, 2:] / OMEGA, atol=1e-8)


def test_the_acceleration_is_that_of_the_pendulum_and_does_not_jump_at_the_end_of_the_ramp():
    t = PROFILE.ramp + np.array([-1e-9, 0.0, 1e-9])
    states = pendulum(t, PROFILE, (START, HOLD), XI, COM, OMEGA)
    np.testing.assert_allclose(states.acceleration, OMEGA**2 * (states.com - states.zmp), atol=1e-13)
    np.testing.assert_allclose(np.diff(states.acceleration, axis=0), 0, atol=1e-6)


def test_the_forward_weights_give_the_divergent_component_at_the_end_and_sum_to_one():
    grow, first, last = forward_weights(PROFILE, OMEGA)
    end = pendulum(np.array([PROFILE.duration]), PROFILE, (START, HOLD), XI, COM, OMEGA)
    np.testing.assert_allclose(grow * XI + first * START + last * HOLD, end.dcm[0], atol=1e-12)
    assert grow + first + last == pytest.approx(1.0, abs=1e-12)


def test_phases_entered_as_told_end_at_rest_over_the_last_point(rng):
    points, profiles = rng.normal(size=(4, 2)), (PROFILE, Profile(0.1, 0.5), Profile(0.3, 0.3), Profile(0.2, 0.9))
    alpha, beta = entry(points, profiles, OMEGA)
    xi, before = alpha * START + beta, START
    for point, profile in zip(points, profiles, strict=True):
        xi = pendulum(np.array([profile.duration]), profile, (before, point), xi, COM, OMEGA).dcm[0]
        before = point
    np.testing.assert_allclose(xi, points[-1], atol=1e-9)


def test_the_holding_point_leads_to_where_the_next_phases_can_be_entered(rng):
    onward = entry(rng.normal(size=(3, 2)), (PROFILE,) * 3, OMEGA)
    hold = holding_point(XI, START, PROFILE, onward, OMEGA)
    end = pendulum(np.array([PROFILE.duration]), PROFILE, (START, hold), XI, COM, OMEGA)
    np.testing.assert_allclose(end.dcm[0], onward[0] * hold + onward[1], atol=1e-12)


def test_periodic_stepping_in_place_has_the_published_offset():
    # Englsberger: with instant change of feet a distance d apart the component starts at d / (1 + exp(omega T)) inside.
    feet = np.array([[0.0, 0.1 * (-1) ** k] for k in range(12)])
    quick = Profile(1e-9, 0.8)
    alpha, beta = entry(feet, (quick,) * 12, OMEGA)
    inside = 0.1 - (alpha * -0.1 + beta[1])
    assert inside == pytest.approx(0.2 / (1 + np.exp(OMEGA * 0.8)), abs=1e-6)
