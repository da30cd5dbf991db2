"""Two-mass model from white noise: known truth of Table 2, intervals that cover, resonance and anti-resonance."""

from __future__ import annotations

import numpy as np
import pytest

from phantom_dyn.errors import EstimationError
from phantom_dyn.haptics.device.axis import RigidAxis
from phantom_dyn.haptics.device.published import LHIFAM, phantom_1_0
from phantom_dyn.haptics.experiments.frequency_identification import NAMES, fit_two_mass, fit_two_mass_of_instants
from phantom_dyn.haptics.experiments.frequency_response import FrequencyResponse
from phantom_dyn.haptics.experiments.white_noise import simulate_white_noise

T = 1e-3
BAND = 2 * np.pi * 300
PHANTOM = phantom_1_0(0.002, 0.003)


def truth(axis):
    return np.array([getattr(axis, name) for name in NAMES])


def fitted(axis, rng, *, force, noise, duration=100.0, delay=0.0):
    experiment = simulate_white_noise(
        axis, period=T, delay=delay, force=force, position_noise=noise, duration=duration, rng=rng
    )
    return fit_two_mass(experiment.frequency_response(segment=4.0).between(0.0, BAND), delay=delay)


@pytest.mark.parametrize(
    ("axis", "force", "noise", "delay"),
    [(LHIFAM, 5.0, 1e-6, 0.0), (LHIFAM, 5.0, 1e-6, 0.25e-3), (PHANTOM, 0.05, 1e-5, 0.0)],
    ids=["lhifam", "lhifam late", "phantom"],
)
def test_the_six_parameters_are_recovered(rng, axis, force, noise, delay):
    # Known truth; four deviations for six parameters, and what the table prints is held to a per cent.
    found = fitted(axis, rng, force=force, noise=noise, delay=delay)
    assert np.all(np.abs(found.values - truth(axis)) < 4 * found.deviations)
    assert found.axis.cable_stiffness == pytest.approx(axis.cable_stiffness, rel=0.01)
    assert found.axis.motor_mass == pytest.approx(axis.motor_mass, rel=0.01)
    assert 0.8 < found.misfit < 1.3


def test_motor_damping_of_the_phantom_is_that_of_the_table(rng):
    found = fitted(PHANTOM, rng, force=0.05, noise=1e-5)
    assert found.axis.motor_damping == pytest.approx(0.0085, rel=0.02)


@pytest.mark.whole
def test_95_per_cent_intervals_cover():
    # 12 experiments of 6 parameters; 95 % of 72 is 68.4, and parameters of one experiment err together.
    inside = []
    for seed in range(12):
        found = fitted(LHIFAM, np.random.default_rng(seed), force=5.0, noise=2e-5)
        low, high = found.interval
        inside.append((low <= truth(LHIFAM)) & (truth(LHIFAM) <= high))
    assert np.mean(inside) >= 0.88


def test_resonance_and_anti_resonance_are_found(rng):
    found = fitted(LHIFAM, rng, force=5.0, noise=2e-5)
    for (value, deviation), true in (
        (found.resonance, LHIFAM.free_frequency),
        (found.anti_resonance, LHIFAM.blocked_frequency),
    ):
        assert abs(value - true) < 4 * deviation
        assert deviation < 2e-3 * true


def test_deviation_of_the_resonance_is_that_of_the_linearised_formula(rng):
    # Oracle: finite differences of the frequencies over the parameters.
    found = fitted(LHIFAM, rng, force=5.0, noise=2e-5)
    for name in ("resonance", "anti_resonance"):
        slope = np.zeros(6)
        for k in (0, 1, 4):
            step = 1e-6 * found.values[k]
            sides = []
            for sign in (1, -1):
                values = found.values.copy()
                values[k] += sign * step
                m, M, *_, stiffness, _ = values
                sides.append(np.sqrt(stiffness / M if name == "anti_resonance" else stiffness * (1 / m + 1 / M)))
            slope[k] = (sides[0] - sides[1]) / (2 * step)
        expected = np.sqrt(slope @ found.covariance @ slope)
        assert getattr(found, name)[1] == pytest.approx(expected, rel=1e-4)


def test_model_without_hold_fits_a_response_of_instants():
    # Known truth: the continuous response itself, with deviations that stand for noise.
    w = np.linspace(10.0, 1500.0, 800)
    exact = LHIFAM.transfer_function.response(w)
    given = FrequencyResponse(T, w, exact, np.full(800, 0.99), np.full(800, 1e-3), 50.0)
    np.testing.assert_allclose(fit_two_mass_of_instants(given).values, truth(LHIFAM), rtol=1e-3)


def test_a_rigid_device_has_no_two_masses(rng):
    with pytest.raises(EstimationError, match=r"cannot distinguish a vibration from none|no resonance after"):
        fitted(RigidAxis(5.4, 3.5), rng, force=5.0, noise=1e-7, duration=30.0)


def test_noise_alone_is_refused(rng):
    with pytest.raises(EstimationError, match="Force and position agree at"):
        fitted(LHIFAM, rng, force=1e-6, noise=1e-2, duration=60.0)
