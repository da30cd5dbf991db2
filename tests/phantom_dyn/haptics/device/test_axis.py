"""Axes of a haptic device: transfer functions, sampling, the hand that holds them."""

import itertools
import math
from dataclasses import replace

import control
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.device.axis import (
    YOKOKOHJI_YOSHIKAWA,
    Operator,
    RigidAxis,
    TwoMassAxis,
    masses_from_resonance,
)
from phantom_dyn.haptics.device.discretisation import discretise, split_delay
from phantom_dyn.haptics.device.frequency_kernels import frequency_grid
from phantom_dyn.haptics.device.held_device import HeldDevice, felt_impedance
from phantom_dyn.haptics.device.published import LHIFAM, LHIFAM_NEW_CABLE, PHANTOM_1_5_X, PHANTOM_1_5_Y, PHANTOM_1_5_Z
from phantom_dyn.haptics.device.transfer_function import TransferFunction

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


@pytest.mark.parametrize(
    ("call", "message"),
    [
        pytest.param(
            lambda: masses_from_resonance(1.0, 100.0, 10.0),
            r"No two masses of 1 together .* give a resonance of 20 rad/s or more",
            id="a resonance that two masses cannot have",
        ),
        pytest.param(
            lambda: replace(AXIS, cable_stiffness=math.nan),
            "cable stiffness of the axis is nan: give a number above 0",
            id="a cable without stiffness",
        ),
        pytest.param(
            lambda: TransferFunction(np.array([1.0, 0.0, 0.0]), np.array([1.0, 1.0])),
            "degree 2 over 1 was given: no device moves before",
            id="a numerator of higher degree",
        ),
        pytest.param(
            lambda: TransferFunction(np.array([1.0]), np.array([0.0, 1.0])),
            r"denominator of a transfer function is \[0\.0, 1\.0\]: give finite",
            id="a leading zero",
        ),
        pytest.param(
            lambda: HeldDevice(LHIFAM, Operator(0.0, 0.0, 0.0), CUTOFF),
            "Nobody holds the device",
            id="nobody at the device",
        ),
        pytest.param(
            lambda: Operator(-1.0, 0.0, 0.0),
            r"mass of the operator is -1\.0: give a number of 0 or more",
            id="negative mass",
        ),
        pytest.param(lambda: RigidAxis(0.0, 1.0), "a number above 0", id="no mass"),
        pytest.param(lambda: RigidAxis(1.0, -1.0), "0 or more", id="negative damping"),
    ],
)
def test_what_cannot_be_is_refused(call, message):
    with pytest.raises(ParameterError, match=message):
        call()


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


@pytest.mark.parametrize("axis", [PHANTOM_1_5_X, PHANTOM_1_5_Y, PHANTOM_1_5_Z], ids="xyz")
def test_state_space_has_the_same_response(axis):
    # Oracle: the fraction itself.
    w = 2 * np.pi * np.array([1.0, 30.0, 100.0, 400.0])
    s = axis.state_space
    answers = [s.C @ np.linalg.solve(1j * f * np.eye(len(s.B)) - s.A, s.B) + s.D for f in w]
    np.testing.assert_allclose(answers, axis.response(w), rtol=1e-9)


def test_a_mount_that_gives_adds_its_compliance():
    axis = PHANTOM_1_5_X.plus(0.5)
    w = np.array([10.0, 500.0])
    np.testing.assert_allclose(axis.response(w), PHANTOM_1_5_X.response(w) + 0.5, rtol=1e-12)


def test_it_is_its_own_transfer_function():
    assert PHANTOM_1_5_X.transfer_function is PHANTOM_1_5_X


T = 1e-3


def test_hold_without_delay_is_that_of_python_control():
    s = LHIFAM.state_space
    there = control.c2d(control.ss(s.A, s.B[:, None], s.C[None], 0), T)
    w = np.array([1.0, 20.0, 125.0, 515.0, 3000.0])
    answers = [complex(there(np.exp(1j * f * T))) for f in w]
    np.testing.assert_allclose(discretise(LHIFAM, period=T).response(w), answers, rtol=1e-9)


@pytest.mark.parametrize("delay", [0.0, 0.25e-3, 1e-3, 2.7e-3])
def test_samples_are_those_of_the_continuous_device(delay):
    # Oracle: integration of the differential equation with the delayed, held force.
    forces = np.array([1.0, -2.0, 0.5, 3.0, 0.0, -1.0, 0.0, 0.0])
    system, sampled = LHIFAM.state_space, discretise(LHIFAM, period=T, delay=delay)
    given = lambda k: forces[k] if 0 <= k < len(forces) else 0.0  # noqa: E731
    x = np.zeros(4)
    for k in range(len(forces)):
        x = (
            sampled.transition @ x
            + sampled.newer * given(k - sampled.steps)
            + sampled.older * given(k - sampled.steps - 1)
        )
    y = np.zeros(4)
    edges = np.unique(np.concatenate([np.arange(len(forces)) * T + delay, [0.0, len(forces) * T]]))
    edges = edges[edges <= len(forces) * T + 1e-12]
    for start, stop in itertools.pairwise(edges):
        held = given(int(np.floor((0.5 * (start + stop) - delay) / T)))
        y = solve_ivp(
            lambda _, z, held=held: system.A @ z + system.B * held,
            (start, stop),
            y,
            method="DOP853",
            rtol=1e-12,
            atol=1e-16,
        ).y[:, -1]
    np.testing.assert_allclose(x, y, rtol=1e-8, atol=1e-14)


def test_a_whole_period_of_delay_turns_the_phase_by_one_z():
    w = np.array([5.0, 300.0, 2000.0])
    late, prompt = discretise(LHIFAM, period=T, delay=3 * T), discretise(LHIFAM, period=T)
    np.testing.assert_allclose(late.response(w), prompt.response(w) * np.exp(-3j * w * T), rtol=1e-12)


def test_response_at_low_frequency_is_that_of_device_half_a_period_and_delay():
    w, delay = np.array([0.5, 2.0]), 2.3e-3
    expected = LHIFAM.transfer_function.response(w) * np.exp(-1j * w * (0.5 * T + delay))
    np.testing.assert_allclose(discretise(LHIFAM, period=T, delay=delay).response(w), expected, rtol=1e-5)


@pytest.mark.parametrize("delay", [0.0, 0.4e-3, 1e-3, 2.6e-3])
@pytest.mark.parametrize("axis", [LHIFAM_NEW_CABLE, PHANTOM_1_5_Z], ids=["lhifam", "phantom z"])
def test_eigenvalues_of_the_wall_are_zeros_of_its_characteristic_equation(axis, delay):
    # (20), with virtual damping: 1 + (K + B (1 - 1/z)/T) L(z) = 0, L by its polynomials.
    K, B = (3000.0, 2.0) if axis is LHIFAM_NEW_CABLE else (0.1, 1e-4)
    sampled = discretise(axis, period=T, delay=delay)
    steps, direct_now, direct_before, denominator, now, before = sampled.loop
    values = np.linalg.eigvals(sampled.closed_loop(K, B))
    z = values[(np.abs(values) > 0.3)]
    low = np.polyval(denominator, z - 1)
    high = np.polyval(now, z - 1) + np.polyval(before, z - 1) / z + (direct_now + direct_before / z) * low
    error = low + (K + B * (1 - 1 / z) / T) * high * z**-steps
    scale = np.array([np.polyval(np.abs(denominator), abs(root - 1)) for root in z])
    assert len(z) >= 4
    assert np.max(np.abs(error) / scale) < 1e-8


def test_frequency_grid_increases_to_the_nyquist_frequency():
    grid = frequency_grid(0.1, T, 5e-3, np.array([[100.0, 1.0]]))
    assert np.all(np.diff(grid) >= 0)
    assert grid[-1] == pytest.approx(np.pi / T)
    assert np.sum((grid > 99) & (grid < 101)) > 10


@pytest.mark.parametrize(("delay", "expected"), [(0.0, (0, 0.0)), (3e-3, (3, 0.0)), (2.5e-3, (2, 0.5e-3))])
def test_delay_splits_into_whole_periods_and_a_rest(delay, expected):
    assert split_delay(T, delay) == (expected[0], pytest.approx(expected[1], abs=1e-15))


@pytest.mark.parametrize(("period", "delay"), [(0.0, 0.0), (1e-3, -1e-3), (np.nan, 0.0)])
def test_impossible_times_are_refused(period, delay):
    with pytest.raises(ParameterError, match="give a positive period and a delay of 0 or more"):
        discretise(RigidAxis(1.0, 1.0), period=period, delay=delay)


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


def test_impedance_at_resonance_is_the_damper_alone():
    hand = Operator(2.0, 3.0, 50.0)
    resonance = 5.0  # rad/s, sqrt(50 / 2)
    np.testing.assert_allclose(hand.impedance(np.array([resonance])), [15j], rtol=1e-12, atol=1e-12)


def test_cited_operator_has_two_kilograms():
    np.testing.assert_array_equal(YOKOKOHJI_YOSHIKAWA.polynomial(), [2.0, 2.0, 10.0])
