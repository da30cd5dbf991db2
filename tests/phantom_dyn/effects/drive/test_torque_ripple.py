from dataclasses import replace

import numpy as np
import pytest

from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.effects.drive.torque_ripple import TorqueRipple
from phantom_dyn.effects.operation import Operation
from phantom_dyn.motion import Motion
from tilt import recorded

EFFECT = TorqueRipple()
THETA = np.array([6.0, 24.5, 0.03, 0.01, 0.7, -2.0])  # two orders, their amplitudes, their phases


def planted(operation: Operation, order: float, amplitude: float, phase: float) -> np.ndarray:
    return operation.transmitted[:, 1] * amplitude * np.sin(order * operation.q[:, 1] + phase)


def test_the_torque_is_the_load_times_the_waves(arm, wide):
    # Law: tl * sum of A sin(n q + p). Pinocchio: tl of an arm without rotors and friction is its drive torque.
    still = np.zeros(3)
    q, load = wide.q[:, 1], inverse_dynamics(replace(arm, viscous_friction=still, coulomb_friction=still), wide)[:, 1]
    expected = load * (0.03 * np.sin(6 * q + 0.7) + 0.01 * np.sin(24.5 * q - 2.0))
    np.testing.assert_allclose(EFFECT.torque(arm, wide, "tilt", THETA)[:, 1], expected, atol=1e-12)


def test_rotors_take_their_torque_before_the_transmission(arm, wide):
    # Closed form: with a rotor of 0.5 kg m^2 the drive gives 0.5 a more, and the load is the same.
    model = arm.model.copy()
    model.armature = np.array([0.0, 0.5, 0.0])
    geared = replace(arm, model=model)
    np.testing.assert_allclose(
        EFFECT.torque(geared, Operation.of(geared, wide), "tilt", THETA),
        EFFECT.torque(arm, wide, "tilt", THETA),
        atol=1e-12,
    )


def test_its_columns_carry_no_noise_of_accelerations_above_the_judged_band(arm, wide):
    # Known truth: an acceleration that shakes at 60 Hz; the band ends at 10.
    shaken = Motion(wide.t, wide.q, wide.v, wide.a + 50.0 * np.sin(2 * np.pi * 60.0 * wide.t)[:, None])
    one, two = (
        EFFECT.signature(arm, replace(Operation.of(arm, motion), band_hz=10.0), "tilt", (12.0,)).columns[250:-250]
        for motion in (wide, shaken)
    )
    np.testing.assert_allclose(one, two, atol=2e-3 * np.abs(one).max())


def test_its_columns_hold_the_load_of_the_motion(arm, wide):
    # Known truth: the load of this motion has next to nothing above 3 Hz, so that a band up to 10 leaves it as it is.
    one, two = (
        EFFECT.signature(arm, replace(wide, band_hz=band), "tilt", (12.0,)).columns[250:-250] for band in (10.0, np.inf)
    )
    np.testing.assert_allclose(one, two, atol=2e-3 * np.abs(two).max())


@pytest.mark.parametrize("order", [6.0, 17.0, 48.0])
def test_a_planted_order_is_found_among_noise(arm, wide, rng, order):
    # Known truth: a wave of about half the noise's deviation, beside a wrong friction and a wrong scale of the model.
    size = float(np.sqrt(np.mean(wide.transmitted[:, 1] ** 2)))
    rest = -0.05 * np.sign(wide.v[:, 1]) - 0.02 * wide.tau[:, 1] + 0.02 * size * rng.normal(size=len(wide.t))
    assert EFFECT.shapes(arm, recorded(wide, planted(wide, order, 0.01, 1.0) + rest), "tilt")[0] == (order,)


def test_the_fit_at_the_order_that_is_found_gives_amplitude_and_phase(arm, wide, rng):
    # Known truth within four standard deviations, by the covariance of least squares.
    operation = recorded(wide, planted(wide, 12.0, 0.02, 0.7) + 0.05 * rng.normal(size=len(wide.t)))
    shape = EFFECT.shapes(arm, operation, "tilt")[0]
    column = EFFECT.signature(arm, operation, "tilt", shape).columns[:, 0]
    coefficients = np.linalg.lstsq(column, (operation.logged - operation.tau)[:, 1], rcond=None)[0]
    std = 0.05 * np.sqrt(np.diag(np.linalg.inv(column.T @ column))).max()
    found = EFFECT.from_coefficients(arm, "tilt", coefficients, shape)
    assert found[0] == 12.0
    assert abs(found[1] - 0.02) < 4 * std < 0.01
    assert abs(found[2] - 0.7) < 4 * std / 0.02


def test_noise_alone_offers_no_order(arm, wide, rng):
    draws = [EFFECT.shapes(arm, recorded(wide, rng.normal(size=len(wide.t))), "tilt") for _ in range(20)]
    assert sum(bool(shapes) for shapes in draws) <= 1


def test_an_order_that_another_finding_has_taken_is_offered_all_the_same(arm, wide):
    # Known truth: a fit with waves has left nothing; what they made is in the torque that is expected.
    operation = recorded(wide, planted(wide, 17.0, 0.05, 1.0))
    taken = operation.after_fit(operation.logged, np.zeros_like(operation.tau))
    assert EFFECT.shapes(arm, taken, "tilt")[0] == (17.0,)


def test_a_joint_at_rest_cannot_show_it(arm, wide):
    assert EFFECT.untestable(arm, wide, "turn") == (
        "turn travels less than one period of any ripple that its sampling rate can show"
    )
    assert EFFECT.shapes(arm, wide, "turn") == ()
    assert EFFECT.untestable(arm, wide, "tilt") is None


def test_the_probe_is_a_wave_of_amplitude_one_and_phase_zero(arm, wide):
    name, direction = EFFECT.probe(arm, wide, "tilt")
    assert name == "amplitude"
    np.testing.assert_allclose(EFFECT.from_coefficients(arm, "tilt", direction, (6.0,)), [6.0, 1.0, 0.0], atol=1e-15)
