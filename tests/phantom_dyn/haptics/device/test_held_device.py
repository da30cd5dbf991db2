"""Held devices with a force sensor: polynomials against states, closed forms of rigid and blocked devices."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.device.axis import FREE_HAND, YOKOKOHJI_YOSHIKAWA, RigidAxis
from phantom_dyn.haptics.device.held_device import HeldDevice, felt_impedance
from phantom_dyn.haptics.device.published import LHIFAM

CUTOFF = 2 * math.pi * 200
W = np.geomspace(1.0, 3000.0, 30)


@pytest.mark.parametrize("device", [LHIFAM, RigidAxis(5.4, 3.5)])
def test_states_and_polynomials_are_one_system(device):
    held = HeldDevice(device, YOKOKOHJI_YOSHIKAWA, CUTOFF)
    system = held.state_space
    states = [system.C @ np.linalg.solve(1j * w * np.eye(len(system.B)) - system.A, system.B) for w in W]
    np.testing.assert_allclose(states, held.transfer_function.response(W), rtol=1e-10)


def test_the_loop_is_what_the_equations_of_motion_give():
    """Closed form: both equations of motion with the hand, solved as they stand at one frequency."""
    s, d, hand = 80j, LHIFAM, YOKOKOHJI_YOSHIKAWA
    tie = d.cable_damping * s + d.cable_stiffness
    held = hand.mass * s**2 + hand.damping * s + hand.stiffness
    motion = np.array(
        [
            [d.motor_mass * s**2 + d.motor_damping * s + tie, -tie],
            [-tie, d.body_mass * s**2 + d.body_damping * s + tie + held],
        ]
    )
    body = np.linalg.solve(motion, [1.0, 0.0])[1]
    loop = HeldDevice(d, hand, CUTOFF).transfer_function.response(np.array([80.0]))
    np.testing.assert_allclose(loop, [held * body / (1 + s / CUTOFF)], rtol=1e-12)


def test_a_stiff_cable_makes_it_the_rigid_device():
    stiff = replace(LHIFAM, cable_stiffness=1e10)
    rigid = HeldDevice(stiff.rigid, YOKOKOHJI_YOSHIKAWA, CUTOFF).transfer_function
    two = HeldDevice(stiff, YOKOKOHJI_YOSHIKAWA, CUTOFF).transfer_function
    np.testing.assert_allclose(two.response(W), rigid.response(W), rtol=1e-3)


@pytest.mark.parametrize("device", [LHIFAM, RigidAxis(5.4, 3.5)])
def test_a_hand_that_pushes_slowly_on_a_spring_is_not_felt_by_the_sensor(device):
    """Closed form: at rest the hand's spring carries all of its own force, so the sensor reads nothing."""
    held = HeldDevice(device, YOKOKOHJI_YOSHIKAWA, CUTOFF)
    rest = -np.linalg.solve(held.state_space.A, held.push)
    assert held.tip @ rest == pytest.approx(1.0 / YOKOKOHJI_YOSHIKAWA.stiffness, rel=1e-9)
    assert held.state_space.C @ rest == pytest.approx(0.0, abs=1e-6)


def test_felt_impedance_of_two_masses_without_help_is_that_of_a_free_motor():
    """Closed form: body, and motor behind the cable, in parallel with the damper to ground."""
    s, d = 1j * W, LHIFAM
    tie = d.cable_damping * s + d.cable_stiffness
    motor = d.motor_mass * s**2 + d.motor_damping * s
    body = d.body_mass * s**2 + d.body_damping * s
    np.testing.assert_allclose(felt_impedance(d, 0.0, W), body + tie * motor / (tie + motor), rtol=1e-9)


def test_felt_impedance_at_low_frequency_is_divided_by_one_and_the_gain():
    low = np.array([1.0])
    np.testing.assert_allclose(felt_impedance(LHIFAM, 5.0, low), felt_impedance(LHIFAM.rigid, 5.0, low), rtol=1e-4)


def test_nobody_at_the_device_is_refused():
    with pytest.raises(ParameterError, match="Nobody holds the device"):
        HeldDevice(LHIFAM, FREE_HAND, CUTOFF)
