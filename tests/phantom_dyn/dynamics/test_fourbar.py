"""A four-bar of unequal links against loop coordinates, which know neither tree nor Pinocchio, and against energy."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from phantom_dyn import load_robot
from phantom_dyn.dynamics.dynamics import (
    forward_dynamics,
    gravity_torque,
    inverse_dynamics,
    mass_matrix,
    modelled_friction,
)
from phantom_dyn.dynamics.tree_motion import tree_motion
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion
from places import ROBOTS


@pytest.fixture
def fourbar(tmp_path) -> Robot:
    """Driven at the crank; rotors on the crank and on the passive rocker."""
    config = tmp_path / "chain.yaml"
    config.write_text(
        "joints: {crank: {rotor_inertia: 2e-3}, rocker: {rotor_inertia: 1e-3}}\n"
        "loops: [{kind: point, frame_a: coupler_pin, frame_b: rocker_pin, active: [crank]}]"
    )
    return load_robot(ROBOTS / "fourbar.urdf", config=config)


def turning(samples: int = 40) -> Motion:
    """A four-bar's crank on its way round: samples one after the other."""
    t = np.linspace(0, 3, samples)
    return Motion(t, (2 * t + np.sin(3 * t))[:, None], (2 + 3 * np.cos(3 * t))[:, None], (-9 * np.sin(3 * t))[:, None])


def loop_coordinates(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Inertia [kg m^2] and potential [J] of the four-bar about its crank, from circles that meet, without a tree.

    Angles turn about +y, from z to x; x and z as complex numbers ``x - 1j z``, so that they turn anticlockwise.
    """
    crank = np.exp(1j * q)
    pin_b, bearing, arm, rocker = 0.1 * crank, 0.3, 0.25 - 0.05j, -0.2j
    apart = bearing - pin_b
    along = (abs(apart) ** 2 + abs(arm) ** 2 - abs(rocker) ** 2) / (2 * abs(apart))
    point = pin_b + (along - 1j * np.sqrt(abs(arm) ** 2 - along**2)) * apart / abs(apart)
    # Rates per unit rate of the crank: point' = pin_b' + 1j w (point - pin_b) = 1j u (point - bearing).
    b, d, speed = point - pin_b, point - bearing, 1j * pin_b
    determinant = (b * d.conjugate()).imag
    w = -(speed / 1j * d.conjugate()).imag / determinant
    u = -(speed / 1j * b.conjugate()).imag / determinant
    center = (0.12 - 0.01j) / arm * b
    center_speed = speed + 1j * w * center
    inertia = (
        1e-3 + 2e-3 + 0.3 * 0.05**2 + 3e-3 * w**2 + 0.5 * abs(center_speed) ** 2 + (2e-3 + 1e-3 + 0.4 * 0.1**2) * u**2
    )
    height = -(0.3 * 0.05 * crank + 0.5 * (pin_b + center) + 0.4 * (bearing + d / 2)).imag
    return inertia, 9.81 * height


def test_a_four_bar_has_the_inertia_of_loop_coordinates(fourbar):
    q = turning().q
    np.testing.assert_allclose(mass_matrix(fourbar, q)[:, 0, 0], loop_coordinates(q[:, 0])[0], rtol=1e-9)


def test_a_four_bar_has_the_torque_of_loop_coordinates(fourbar):
    # Lagrange with one coordinate: I a + I' v^2 / 2 + V', slopes by central differences.
    m, step = turning(), 1e-5
    q, v, a = m.q[:, 0], m.v[:, 0], m.a[:, 0]
    (inertia_up, height_up), (inertia_down, height_down) = (loop_coordinates(q + s * step) for s in (1, -1))
    slope, force = (inertia_up - inertia_down) / (2 * step), (height_up - height_down) / (2 * step)
    expected = loop_coordinates(q)[0] * a + slope * v**2 / 2 + force
    torque = inverse_dynamics(fourbar, m) - modelled_friction(fourbar, m)
    np.testing.assert_allclose(torque[:, 0], expected, atol=1e-8)


def energy(robot: Robot, m: Motion) -> np.ndarray:
    """Kinetic energy with rotors, and potential energy, of every sample, from Pinocchio's tree."""
    tree, data = tree_motion(robot, m), robot.model.createData()
    return np.array(
        [pin.computeMechanicalEnergy(robot.model, data, q, v) for q, v in zip(tree.configuration, tree.v, strict=True)]
    )


def test_torque_times_velocity_is_the_rate_of_energy(fourbar):
    def moved(t: np.ndarray) -> Motion:
        return Motion(t, np.sin(2 * t)[:, None], 2 * np.cos(2 * t)[:, None], -4 * np.sin(2 * t)[:, None])

    t, step = np.linspace(0, 3, 30), 1e-5
    rate = (energy(fourbar, moved(t + step)) - energy(fourbar, moved(t - step))) / (2 * step)
    m = moved(t)
    torque = inverse_dynamics(fourbar, m) - modelled_friction(fourbar, m)
    np.testing.assert_allclose((torque * m.v).sum(axis=1), rate, atol=1e-7)


def test_a_four_bar_without_friction_keeps_its_energy(fourbar):
    def rate(state: np.ndarray) -> np.ndarray:
        q, v = state[:1][None], state[1:][None]
        free = modelled_friction(fourbar, Motion(np.zeros(1), q, v, np.zeros((1, 1))))
        return np.array([v[0, 0], forward_dynamics(fourbar, q, v, free)[0, 0]])

    state, step, states = np.array([0.4, 1.0]), 2e-3, []
    for _ in range(100):
        states.append(state)
        k1 = rate(state)
        k2 = rate(state + step / 2 * k1)
        k3 = rate(state + step / 2 * k2)
        state = state + step / 6 * (k1 + 2 * k2 + 2 * k3 + rate(state + step * k3))
    q, v = np.array(states)[:, :1], np.array(states)[:, 1:]
    kept = energy(fourbar, Motion(np.arange(100.0), q, v, np.zeros_like(v)))
    assert np.ptp(q) > 0.2
    np.testing.assert_allclose(kept, kept[0], atol=1e-8)


def test_gravity_torque_is_the_slope_of_the_potential_of_loop_coordinates(fourbar):
    q, step = turning().q[:, 0], 1e-5
    slope = (loop_coordinates(q + step)[1] - loop_coordinates(q - step)[1]) / (2 * step)
    np.testing.assert_allclose(gravity_torque(fourbar, q[:, None])[:, 0], slope, atol=1e-8)


def test_samples_one_by_one_are_those_of_the_whole_motion(fourbar):
    m = turning()
    one_by_one = [
        inverse_dynamics(fourbar, Motion(m.t[k : k + 1], m.q[k : k + 1], m.v[k : k + 1], m.a[k : k + 1]))[0]
        for k in range(len(m.t))
    ]
    np.testing.assert_allclose(one_by_one, inverse_dynamics(fourbar, m), atol=1e-12)
