"""Relay experiments on the LHIfAM with the new cable: two limit cycles, and which start leads to which."""

from __future__ import annotations

import math

import numpy as np
import pytest

from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.device.axis import RigidAxis
from phantom_dyn.haptics.device.published import LHIFAM_NEW_CABLE
from phantom_dyn.haptics.experiments.relay import RelayExperiment, limit_cycle, simulate_relay
from phantom_dyn.haptics.stability.critical_stiffness import critical_stiffness

T = 1e-3
HZ = 2 * math.pi
SMALL, LARGE = 1e-6, 10e-3  # starts [m]


def cycle(start: float, milliseconds: int):
    experiment = simulate_relay(
        LHIFAM_NEW_CABLE, period=T, delay=milliseconds * T, force=5.0, start=start, duration=60.0
    )
    return limit_cycle(experiment)


@pytest.mark.parametrize(
    ("milliseconds", "hertz", "decibels"), [(0, 70.80, 87.7), (1, 62.5, 80.4), (3, 57.6, 73.6), (4, 56.5, 73.0)]
)
def test_a_small_start_ends_in_the_vibration(milliseconds, hertz, decibels):
    found = cycle(SMALL, milliseconds)
    assert found.frequency / HZ == pytest.approx(hertz, abs=0.12)  # the resolution of the spectrum
    assert found.decibels == pytest.approx(decibels, abs=0.2)


@pytest.mark.parametrize(("milliseconds", "hertz", "decibels"), [(0, 5.13, 76.1), (4, 1.95, 58.5), (8, 1.34, 51.7)])
def test_a_large_start_ends_in_the_swing_of_the_rigid_device(milliseconds, hertz, decibels):
    found = cycle(LARGE, milliseconds)
    assert found.frequency / HZ == pytest.approx(hertz, abs=0.12)
    assert found.decibels == pytest.approx(decibels, abs=0.2)


def test_without_delay_a_small_start_gives_the_critical_stiffness():
    found, theory = cycle(SMALL, 0), critical_stiffness(LHIFAM_NEW_CABLE, period=T)
    assert found.frequency == pytest.approx(theory.frequency, rel=2e-3)
    assert found.decibels == pytest.approx(theory.decibels, abs=0.1)


@pytest.mark.parametrize("milliseconds", [4, 6, 8])
def test_with_delay_a_large_start_gives_the_critical_stiffness(milliseconds):
    found, theory = cycle(LARGE, milliseconds), critical_stiffness(LHIFAM_NEW_CABLE, period=T, delay=milliseconds * T)
    assert found.frequency == pytest.approx(theory.frequency, rel=0.05)
    assert found.decibels == pytest.approx(theory.decibels, abs=1.0)


def test_force_and_position_are_in_counterphase():
    experiment = simulate_relay(LHIFAM_NEW_CABLE, period=T, force=5.0, start=SMALL, duration=20.0)
    late = slice(10000, None)
    assert np.corrcoef(experiment.force[late], experiment.position[late])[0, 1] < -0.8


def test_a_rigid_device_swings_as_the_delayed_relay_lets_it():
    # Closed form of the describing function of a held relay: phase -180 degrees where b/(m w) = w-lag of the loop,
    # tan(w (T/2 + t_d)) = b / (m w); the sampling of the relay adds up to one period to the lag.
    m, b, delay = 1.0, 10.0, 20e-3
    found = limit_cycle(simulate_relay(RigidAxis(m, b), period=T, delay=delay, force=1.0, start=0.1, duration=60.0))
    bounds = []
    for lag in (delay, delay + 1.5 * T):
        w = np.linspace(1.0, 70.0, 200001)
        bounds.append(w[np.argmin(np.abs(np.tan(w * lag) - b / (m * w)))])
    assert bounds[1] * 0.95 < found.frequency < bounds[0] * 1.05  # harmonics shift it by some per cent


def test_stiffness_is_the_ratio_of_first_harmonics():
    # Known truth: a square wave of 2 and a sine of 0.01, at 12.3 Hz between two lines of the spectrum.
    t = T * np.arange(40000)
    swing = np.sin(HZ * 12.3 * t)
    found = limit_cycle(RelayExperiment(T, 0.0, t, -2 * np.sign(swing), 0.01 * swing))
    assert found.frequency / HZ == pytest.approx(12.3, abs=0.02)
    assert found.stiffness == pytest.approx(4 / math.pi * 2 / 0.01, rel=0.01)
    assert found.amplitude == pytest.approx(0.01, rel=0.02)


def test_a_force_of_zero_is_refused():
    with pytest.raises(ParameterError, match=r"force of the relay is 0.*: give a number above 0"):
        simulate_relay(LHIFAM_NEW_CABLE, period=T, force=0.0, start=SMALL, duration=1.0)


def test_a_short_experiment_is_refused():
    with pytest.raises(ParameterError, match="of 50 samples was asked for"):
        simulate_relay(LHIFAM_NEW_CABLE, period=T, force=1.0, start=SMALL, duration=0.05)


def test_too_little_left_after_settling_is_refused():
    t = T * np.arange(100)
    with pytest.raises(ParameterError, match="60 samples are left"):
        limit_cycle(RelayExperiment(T, 0.0, t, np.ones(100), np.ones(100)))
