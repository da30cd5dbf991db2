import numpy as np
import pytest

from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.effects.encoder.encoder_eccentricity import EncoderEccentricity
from phantom_dyn.effects.operation import Operation
from phantom_dyn.motion import Motion
from phantom_dyn.simulation.simulate import Cause, simulate

EFFECT = EncoderEccentricity()
THETA = np.array([0.02, 0.7, 1.0])


def read_with_error(motion: Motion, joint: int, theta: np.ndarray = THETA) -> Motion:
    """What an eccentric encoder reads, by the chain rule."""
    amplitude, phase, n = theta
    q, v, a = motion.q.copy(), motion.v.copy(), motion.a.copy()
    angle = n * motion.q[:, joint] + phase
    q[:, joint] += amplitude * np.sin(angle)
    v[:, joint] *= 1.0 + n * amplitude * np.cos(angle)
    a[:, joint] += n * amplitude * (np.cos(angle) * motion.a[:, joint] - n * np.sin(angle) * motion.v[:, joint] ** 2)
    return Motion(motion.t, q, v, a)


@pytest.mark.parametrize("joint", ["turn", "tilt"])
def test_the_law_is_the_difference_of_inverse_dynamics_as_read_and_true(arm, operation, joint):
    # Known truth: the operation is what truly happens.
    read = read_with_error(operation, arm.joint_names.index(joint))
    law = EFFECT.torque(arm, Operation.of(arm, read), joint, THETA)
    np.testing.assert_allclose(law, inverse_dynamics(arm, read) - inverse_dynamics(arm, operation), atol=1e-9)


def test_the_true_angle_is_found_under_a_large_error_of_two_periods_a_turn(arm, operation):
    # Known truth: an error that takes away or adds up to four fifths of the speed.
    theta = np.array([0.4, -1.1, 2.0])
    read = read_with_error(operation, 1, theta)
    law = EFFECT.torque(arm, Operation.of(arm, read), "tilt", theta)
    np.testing.assert_allclose(law, inverse_dynamics(arm, read) - inverse_dynamics(arm, operation), atol=1e-8)


@pytest.mark.parametrize("joint", ["turn", "tilt"])
def test_the_columns_are_the_slope_of_the_law_in_amplitude(arm, operation, joint):
    # Finite difference about zero.
    columns = EFFECT.signature(arm, operation, joint, ()).columns
    for phase, coefficients in ((0.0, [1.0, 0.0]), (0.5 * np.pi, [0.0, 1.0])):
        ends = [EFFECT.torque(arm, operation, joint, np.array([size, phase, 1.0])) for size in (-1e-6, 1e-6)]
        np.testing.assert_allclose((ends[1] - ends[0]) / 2e-6, -columns @ coefficients, rtol=1e-5, atol=1e-5)


def test_a_sine_and_a_cosine_make_amplitude_and_phase(arm):
    # A sin(q + p) = A cos(p) sin(q) + A sin(p) cos(q).
    coefficients = 0.02 * np.array([np.cos(0.7), np.sin(0.7)])
    np.testing.assert_allclose(EFFECT.from_coefficients(arm, "tilt", coefficients, ()), THETA)


def test_the_recording_shows_the_law(planar, swinging):
    controller, q0, v0 = swinging
    s = simulate(planar, (Cause(EFFECT, "elbow", THETA),), controller, np.linspace(0, 0.3, 61), q0, v0)
    read = Operation.of(planar, read_with_error(s.encoders, 1))
    np.testing.assert_allclose(read.q, s.q, atol=1e-12)
    law = EFFECT.torque(planar, read, "elbow", THETA)
    steady = np.abs(s.links.v).min(axis=1) > 0.3
    assert np.abs(law).max() > 0.1
    np.testing.assert_allclose((s.tau - read.tau + law)[steady][1:-1], 0.0, atol=0.01)


def test_only_joints_that_turn_have_an_eccentric_encoder(arm):
    assert EFFECT.places(arm) == ("turn", "tilt")


@pytest.mark.parametrize(("arc", "shown"), [(0.49, False), (0.51, True)])
def test_an_arc_of_half_a_radian_can_show_it(arm, operation, arc, shown):
    q = operation.q * arc / np.ptp(operation.q, axis=0)
    turned = Operation.of(arm, Motion(operation.t, q, operation.v, operation.a))
    assert EFFECT.looks_like(arm, turned, "tilt", "encoder_offset", np.array([0.02])) != shown
    why = EFFECT.untestable(arm, turned, "tilt")
    assert why == (None if shown else "the joint turns by 0.49 rad only: over so small an arc a sine looks like a line")


def test_the_probe_is_an_amplitude_of_phase_zero(arm, operation):
    name, direction = EFFECT.probe(arm, operation, "tilt")
    assert name == "amplitude"
    np.testing.assert_array_equal(EFFECT.from_coefficients(arm, "tilt", direction, ()), [1.0, 0.0, 1.0])
