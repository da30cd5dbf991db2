"""Force feedforward: the figures of the chapter, closed forms, and eigenvalues of the loop."""

from __future__ import annotations

import math

import numpy as np
import pytest

from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.device.axis import FREE_HAND, YOKOKOHJI_YOSHIKAWA, Operator, RigidAxis
from phantom_dyn.haptics.device.published import LHIFAM as VIBRATING
from phantom_dyn.haptics.stability.force_feedforward import (
    Feedforward,
    critical_feedforward,
    feedforward_loop,
    felt_mass,
    low_pass,
    transparency,
    worst_critical_feedforward,
)

LHIFAM = RigidAxis(5.4, 3.5)
LIGHT_HAND = Operator(0.271, 0.271, 1.355)  # the cited operator scaled to the mass that gives the printed 0.14 kg
BUTTERWORTH = Feedforward(filter=low_pass(2 * math.pi * 30, period=1e-3))


def test_a_gain_of_two_raises_the_response_by_9_542_decibel():
    frequency = np.array([2e3])
    without = transparency(LHIFAM, FREE_HAND, Feedforward(), 0.0, frequency).ideal
    helped = transparency(LHIFAM, FREE_HAND, Feedforward(), 2.0, frequency).ideal
    assert 20 * math.log10(abs(helped[0] / without[0])) == pytest.approx(9.542, abs=5e-4)


@pytest.mark.parametrize(("gain", "mass"), [(2, 1.8), (5, 0.9)])
def test_the_felt_mass_of_the_published_gains(gain, mass):
    assert felt_mass(5.4, gain) == pytest.approx(mass, rel=1e-12)


def test_hold_and_sensor_filter_leave_0_556893_at_the_nyquist_frequency():
    """Exact sampled loop of a hand that is all mass on a device without friction: gain over m_h / (m + m_h)."""
    loop = feedforward_loop(RigidAxis(5.4, 0.0), Operator(2.0, 0.0, 0.0), Feedforward())
    assert abs(loop.open_loop(np.array([math.pi / 1e-3]))[0]) / (2.0 / 7.4) == pytest.approx(0.556893, abs=1e-6)


@pytest.mark.parametrize(("hand", "gain", "mass"), [(YOKOKOHJI_YOSHIKAWA, 6.644, 0.706), (LIGHT_HAND, 37.57, 0.140)])
def test_critical_gain_and_the_mass_that_is_left(hand, gain, mass):
    """The printed 0.14 kg needs a hand of 0.271 kg; the cited 2 kg leave 0.706 kg."""
    result = critical_feedforward(LHIFAM, hand, Feedforward())
    assert result.gain == pytest.approx(gain, rel=1e-3)
    assert felt_mass(5.4, result.gain) == pytest.approx(mass, abs=5e-4)


def test_without_delay_the_phase_crosses_at_the_nyquist_frequency():
    assert critical_feedforward(LHIFAM, YOKOKOHJI_YOSHIKAWA, Feedforward()).frequency == math.pi / 1e-3


@pytest.mark.parametrize(
    ("milliseconds", "gain"), [(1, 5.172), (2, 4.488), (5, 3.938), (10, 3.777), (20, 3.723), (50, 3.707)]
)
def test_delay_lowers_the_critical_gain_of_the_two_kilogram_hand(milliseconds, gain):
    result = critical_feedforward(LHIFAM, YOKOKOHJI_YOSHIKAWA, Feedforward(delay=milliseconds * 1e-3))
    assert result.gain == pytest.approx(gain, abs=6e-4)


def test_a_millisecond_moves_the_crossing_to_227_hertz():
    result = critical_feedforward(LHIFAM, YOKOKOHJI_YOSHIKAWA, Feedforward(delay=1e-3))
    assert result.frequency / (2 * math.pi) == pytest.approx(227, abs=0.5)


@pytest.mark.parametrize(("hand", "gain"), [(YOKOKOHJI_YOSHIKAWA, 9.41), (Operator(0.271, 2.0, 10.0), 53.3)])
def test_a_quarter_of_a_period_raises_the_critical_gain(hand, gain):
    result = critical_feedforward(LHIFAM, hand, Feedforward(delay=0.25e-3))
    assert result.gain == pytest.approx(gain, rel=2e-3)
    assert result.frequency == math.pi / 1e-3


@pytest.mark.parametrize(("hand_mass", "worst"), [(2.0, 3.7), (0.271, 20.92)])
def test_worst_case_is_one_and_the_ratio_of_masses(hand_mass, worst):
    assert worst_critical_feedforward(5.4, hand_mass) == pytest.approx(worst, rel=3e-4)


def test_a_light_hand_under_a_large_delay_comes_near_its_worst_case():
    result = critical_feedforward(LHIFAM, LIGHT_HAND, Feedforward(delay=0.05))
    assert result.gain == pytest.approx(20.98, abs=0.02)


def test_an_infinitely_heavy_hand_still_lets_the_mass_be_halved():
    assert felt_mass(5.4, worst_critical_feedforward(5.4, math.inf)) == pytest.approx(2.7, rel=1e-12)


@pytest.mark.parametrize(("hand", "gain"), [(YOKOKOHJI_YOSHIKAWA, 23.1), (Operator(0.271, 2.0, 10.0), 127.7)])
def test_butterworth_filter_of_30_hertz_allows_more(hand, gain):
    result = critical_feedforward(LHIFAM, hand, BUTTERWORTH)
    assert result.gain == pytest.approx(gain, rel=1e-3)
    assert result.frequency / (2 * math.pi) == pytest.approx(71, abs=0.6)  # close to the 82 Hz of the cable


def test_the_gain_of_five_that_was_used_is_stable_with_the_filter_and_above_the_worst_case_without():
    assert feedforward_loop(LHIFAM, YOKOKOHJI_YOSHIKAWA, BUTTERWORTH).spectral_radius(5.0) < 1
    assert feedforward_loop(LHIFAM, YOKOKOHJI_YOSHIKAWA, Feedforward(delay=0.05)).spectral_radius(5.0) > 1


@pytest.mark.parametrize("feedforward", [Feedforward(), Feedforward(delay=1.3e-3), BUTTERWORTH])
def test_spectral_radius_passes_one_at_the_critical_gain(feedforward):
    loop = feedforward_loop(LHIFAM, YOKOKOHJI_YOSHIKAWA, feedforward)
    gain = critical_feedforward(LHIFAM, YOKOKOHJI_YOSHIKAWA, feedforward).gain
    assert loop.spectral_radius(0.999 * gain) < 1 < loop.spectral_radius(1.001 * gain)


def test_felt_inertia_is_that_of_the_gain_at_low_frequency_and_the_bare_mass_past_the_filter():
    result = transparency(LHIFAM, YOKOKOHJI_YOSHIKAWA, BUTTERWORTH, 5.0, np.array([3.0, 2900.0]))
    assert result.apparent_inertia[0] == pytest.approx(0.9, rel=0.05)
    assert result.apparent_inertia[1] == pytest.approx(5.4, rel=0.05)


def test_sampled_response_is_the_ideal_one_where_nothing_is_late():
    fast = Feedforward(period=1e-7, cutoff=1e9)
    result = transparency(LHIFAM, YOKOKOHJI_YOSHIKAWA, fast, 2.0, np.array([1.0, 10.0, 100.0]))
    np.testing.assert_allclose(result.response, result.ideal, rtol=1e-4)


def test_ideal_response_is_equation_28_written_out():
    s = 7j
    hand = YOKOKOHJI_YOSHIKAWA
    written = 1 / (5.4 / 3 * s**2 + 3.5 / 3 * s + hand.mass * s**2 + hand.damping * s + hand.stiffness)
    ideal = transparency(LHIFAM, hand, Feedforward(), 2.0, np.array([7.0])).ideal
    np.testing.assert_allclose(ideal, [written], rtol=1e-12)


def test_with_the_vibration_the_used_gain_of_five_is_stable_with_the_low_pass_and_not_without():
    """The chapter: a low pass of 30 Hz is required because of the mode at 82 Hz, and a gain of 5 was used."""
    assert feedforward_loop(VIBRATING, YOKOKOHJI_YOSHIKAWA, BUTTERWORTH).spectral_radius(5.0) < 1
    assert feedforward_loop(VIBRATING, YOKOKOHJI_YOSHIKAWA, Feedforward()).spectral_radius(5.0) > 1


@pytest.mark.parametrize(("feedforward", "gain", "hertz"), [(Feedforward(), 0.700, 86.9), (BUTTERWORTH, 6.858, 66.2)])
def test_the_vibration_sets_the_limit_between_its_resonance_and_the_low_pass(feedforward, gain, hertz):
    """Values of this loop, held to it by the spectral radius; rigid it bears 6.64 and 23.1."""
    result = critical_feedforward(VIBRATING, YOKOKOHJI_YOSHIKAWA, feedforward)
    assert result.gain == pytest.approx(gain, abs=1e-3)
    assert result.frequency / (2 * math.pi) == pytest.approx(hertz, abs=0.1)
    loop = feedforward_loop(VIBRATING, YOKOKOHJI_YOSHIKAWA, feedforward)
    assert loop.spectral_radius(0.999 * result.gain) < 1 < loop.spectral_radius(1.001 * result.gain)


def test_nobody_at_the_device_is_refused():
    with pytest.raises(ParameterError, match="Nobody holds the device"):
        critical_feedforward(LHIFAM, FREE_HAND, Feedforward())


def test_a_negative_delay_is_refused():
    with pytest.raises(ParameterError, match="delay of the feedforward is -1"):
        Feedforward(delay=-1.0)


def test_a_period_of_nothing_is_refused():
    with pytest.raises(ParameterError, match="period of the feedforward is 0"):
        Feedforward(period=0.0)


def test_a_cutoff_past_half_the_sampling_is_refused():
    with pytest.raises(ParameterError, match=r"below 3141\.59 rad/s"):
        low_pass(4000.0, period=1e-3)


def test_a_hand_without_mass_has_no_worst_case():
    with pytest.raises(ParameterError, match="give a hand's mass above 0"):
        worst_critical_feedforward(5.4, 0.0)


def test_a_bode_diagram_at_standstill_is_refused():
    with pytest.raises(ParameterError, match="frequencies above 0"):
        transparency(LHIFAM, YOKOKOHJI_YOSHIKAWA, Feedforward(), 1.0, np.zeros(1))
