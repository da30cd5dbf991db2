"""Rigid and two-mass devices: equations of motion, and the figures that the chapter derives from them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.device.axis import Operator, RigidAxis, TwoMassAxis, masses_from_resonance
from phantom_dyn.haptics.device.published import LHIFAM

AXIS = TwoMassAxis(0.3, 5.0, 0.1, 3.4, 8e4, 14.0)


def by_equations_of_motion(axis: TwoMassAxis, w: float) -> complex:
    # Closed form: the two force balances, solved for the motor's position.
    s = 1j * w
    cable = axis.cable_stiffness + axis.cable_damping * s
    balance = np.array(
        [
            [axis.motor_mass * s**2 + axis.motor_damping * s + cable, -cable],
            [-cable, axis.body_mass * s**2 + axis.body_damping * s + cable + axis.ground_stiffness],
        ]
    )
    return complex(np.linalg.solve(balance, [1.0, 0.0])[0])


@pytest.mark.parametrize("axis", [AXIS, AXIS.held_by(Operator(2.0, 2.0, 10.0))], ids=["free", "held"])
@pytest.mark.parametrize("w", [0.5, 20.0, 125.0, 515.0, 3000.0])
def test_transfer_function_is_that_of_the_equations_of_motion(axis, w):
    assert axis.transfer_function.response(np.array([w]))[0] == pytest.approx(by_equations_of_motion(axis, w), rel=1e-9)


@pytest.mark.parametrize("axis", [AXIS, RigidAxis(2.0, 3.0, 4.0), AXIS.held_by(Operator(2.0, 2.0, 10.0))])
def test_state_space_is_the_same_device(axis):
    w = np.array([0.7, 30.0, 500.0])
    system = axis.state_space
    answers = [system.C @ np.linalg.solve(1j * f * np.eye(len(system.B)) - system.A, system.B) for f in w]
    np.testing.assert_allclose(answers, axis.transfer_function.response(w), rtol=1e-9)


def test_a_stiff_cable_makes_a_rigid_device():
    stiff = replace(AXIS, cable_stiffness=1e12)
    w = np.array([1.0, 10.0, 100.0])
    np.testing.assert_allclose(stiff.transfer_function.response(w), AXIS.rigid.transfer_function.response(w), rtol=1e-6)


def test_resonance_is_where_the_undamped_device_answers_without_limit():
    # (22): the undamped poles.
    bare = replace(AXIS, motor_damping=0.0, body_damping=0.0, cable_damping=0.0)
    assert np.abs(bare.transfer_function.poles).max() == pytest.approx(AXIS.free_frequency, rel=1e-9)
    assert np.abs(bare.transfer_function.zeros).max() == pytest.approx(AXIS.blocked_frequency, rel=1e-9)


def test_peak_distance_of_the_lhifam_is_that_of_its_peak():
    # Published 78.16 dB; (23) gives 78.168 dB with b_c = 13.82 and the exact peak is 78.160 dB.
    axis = replace(LHIFAM, cable_damping=13.82)
    w = axis.free_frequency * np.linspace(0.95, 1.05, 20001)
    exact = -20 * np.log10(np.abs(axis.transfer_function.response(w)).max())
    assert axis.peak_distance == pytest.approx(78.168, abs=5e-4)
    assert exact == pytest.approx(78.160, abs=2e-3)  # 13.82 is rounded


def test_two_masses_follow_from_sum_spring_and_resonance():
    light, heavy = masses_from_resonance(5.3, 8e4, TwoMassAxis(0.3, 5.0, 0, 0, 8e4, 0).free_frequency)
    assert (light, heavy) == (pytest.approx(0.3, rel=1e-12), pytest.approx(5.0, rel=1e-12))


def test_a_resonance_that_two_masses_cannot_have_is_refused():
    with pytest.raises(ParameterError, match=r"No two masses of 1 together .* give a resonance of 20 rad/s or more"):
        masses_from_resonance(1.0, 100.0, 10.0)


def test_the_hand_loads_the_body():
    held = AXIS.held_by(Operator(2.0, 3.0, 10.0))
    assert (held.body_mass, held.body_damping, held.ground_stiffness) == (7.0, 6.4, 10.0)
    assert held.motor_mass == AXIS.motor_mass


def test_the_hand_loads_a_rigid_device():
    assert RigidAxis(1.0, 2.0).held_by(Operator(2.0, 3.0, 10.0)) == RigidAxis(3.0, 5.0, 10.0)


def test_damping_is_added_at_the_motor():
    assert AXIS.damped(2.0).motor_damping == pytest.approx(2.1)
    assert RigidAxis(1.0, 2.0).damped(2.0).damping == 4.0


def test_a_device_at_rest_stays_there():
    np.testing.assert_array_equal(AXIS.state_space.A @ AXIS.rest(0.01), np.zeros(4))
    np.testing.assert_array_equal(RigidAxis(1.0, 2.0).state_space.A @ RigidAxis(1.0, 2.0).rest(0.01), np.zeros(2))


@pytest.mark.parametrize(("mass", "damping", "say"), [(0.0, 1.0, "a positive number"), (1.0, -1.0, "0 or more")])
def test_impossible_values_are_refused(mass, damping, say):
    with pytest.raises(ParameterError, match=say):
        RigidAxis(mass, damping)


def test_a_cable_without_stiffness_is_refused():
    with pytest.raises(ParameterError, match="cable_stiffness of the axis is nan: give a positive number"):
        replace(AXIS, cable_stiffness=math.nan)
