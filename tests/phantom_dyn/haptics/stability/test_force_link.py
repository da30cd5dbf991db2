"""Force feedforward over a noisy link that loses samples: spectra, the loop without loss, and simulation."""

from __future__ import annotations

import math

import numpy as np
import pytest

from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.device.axis import YOKOKOHJI_YOSHIKAWA, RigidAxis
from phantom_dyn.haptics.device.published import LHIFAM
from phantom_dyn.haptics.stability.force_feedforward import (
    Feedforward,
    critical_feedforward,
    feedforward_loop,
    low_pass,
    transparency,
)
from phantom_dyn.haptics.stability.force_link import (
    ForceLink,
    critical_feedforward_of_link,
    mean_square_radius,
    noise_felt,
    simulate_link,
)

HAND = YOKOKOHJI_YOSHIKAWA
FILTER = low_pass(2 * math.pi * 30, period=1e-3)
FILTERED = Feedforward(filter=FILTER)
RIGID = RigidAxis(5.4, 3.5)


@pytest.mark.parametrize("delay", [0.0, 2e-3, 2.3e-3])
def test_without_loss_the_moments_grow_as_the_square_of_the_spectral_radius(delay):
    late = Feedforward(filter=FILTER, delay=delay)
    radius = feedforward_loop(LHIFAM, HAND, late).spectral_radius(5.0)
    assert mean_square_radius(LHIFAM, HAND, late, 5.0, ForceLink()) == pytest.approx(radius**2, rel=1e-10)


def test_the_limit_of_a_link_without_loss_is_that_of_the_loop():
    limit = critical_feedforward(LHIFAM, HAND, FILTERED).gain
    assert critical_feedforward_of_link(LHIFAM, HAND, FILTERED, ForceLink(noise=1.0)) == limit


def test_the_moments_stand_still_at_the_limit_with_loss():
    link = ForceLink(loss=0.5)
    limit = critical_feedforward_of_link(RIGID, HAND, Feedforward(), link)
    assert mean_square_radius(RIGID, HAND, Feedforward(), limit, link) == pytest.approx(1.0, abs=1e-8)


@pytest.mark.parametrize("loss", [0.1, 0.5, 0.9])
def test_a_rigid_device_bears_less_gain_the_more_is_lost_and_never_less_than_one_and_the_ratio_of_masses(loss):
    """Oracle: (33), the limit under a large delay, which a sample that is held for long amounts to."""
    limit = critical_feedforward_of_link(RIGID, HAND, Feedforward(), ForceLink(loss=loss))
    assert 3.7 < limit < critical_feedforward(RIGID, HAND, Feedforward()).gain


@pytest.mark.parametrize(("share", "grows"), [(0.9, False), (1.15, True)])
def test_simulated_motion_grows_past_the_limit_with_loss(share, grows, rng):
    link = ForceLink(noise=0.1, loss=0.5)
    gain = share * critical_feedforward_of_link(RIGID, HAND, Feedforward(), link)
    force = np.abs(simulate_link(RIGID, HAND, Feedforward(), gain, link, np.zeros(4000), rng).motor_force)
    assert (force[-500:].max() > 100 * force[:500].max()) == grows


@pytest.mark.parametrize("gain", [1.0, 5.0])
def test_motor_force_of_the_noise_is_the_area_under_its_spectrum(gain):
    """Oracle: the integral of the closed loop's frequency response over the Nyquist band."""
    w = np.linspace(1e-3, math.pi / 1e-3, 1_000_001)
    passed, device = FILTER.response(w, 1e-3), feedforward_loop(LHIFAM, HAND, FILTERED).plants[0].response(w)
    density = np.abs(gain * passed / (1 + gain * passed * device)) ** 2
    expected = 0.1 * math.sqrt(np.trapezoid(density, w) * 1e-3 / math.pi)
    felt = noise_felt(LHIFAM, HAND, FILTERED, gain, ForceLink(noise=0.1))
    assert felt.motor_force == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("link", [ForceLink(noise=0.1), ForceLink(noise=0.1, loss=0.2)])
def test_a_long_simulation_has_the_stationary_motor_force(link, rng):
    late = Feedforward(filter=FILTER, delay=1.3e-3)
    trace = simulate_link(LHIFAM, HAND, late, 3.0, link, np.zeros(60_000), rng)
    felt = noise_felt(LHIFAM, HAND, late, 3.0, link)
    assert trace.motor_force[5000:].std() == pytest.approx(felt.motor_force, rel=0.05)


def test_a_lost_sample_leaves_the_motor_with_the_last_one_through_the_filter(rng):
    """Oracle: the filter's difference equation on the readings that arrived, written out."""
    link = ForceLink(noise=0.1, loss=0.4)
    trace = simulate_link(RIGID, HAND, FILTERED, 2.0, link, np.sin(0.01 * np.arange(300)), rng)
    held, heard, out = 0.0, [0.0, 0.0], [0.0, 0.0]
    (b0, b1, b2), (_, a1, a2) = FILTER.numerator, FILTER.denominator
    for k in range(300):
        held = trace.reading[k] if trace.arrived[k] else held
        new = b0 * held + b1 * heard[0] + b2 * heard[1] - a1 * out[0] - a2 * out[1]
        heard, out = [held, heard[0]], [new, out[0]]
        assert trace.motor_force[k] == pytest.approx(2.0 * new, rel=1e-9, abs=1e-12)


def test_what_the_hand_feels_of_the_noise_is_in_the_simulation_too(rng):
    """A stiff hand, so that its motion under noise settles within seconds."""
    hand, link = type(HAND)(2.0, 60.0, 2000.0), ForceLink(noise=0.1, loss=0.2)
    trace = simulate_link(LHIFAM, hand, FILTERED, 1.0, link, np.zeros(60_000), rng)
    felt = noise_felt(LHIFAM, hand, FILTERED, 1.0, link)
    assert trace.tip[5000:].std() == pytest.approx(felt.tip, rel=0.05)
    # The reading has the noise on top, drawn apart from what the state holds then.
    assert trace.reading[5000:].std() == pytest.approx(math.hypot(felt.hand_force, 0.1), rel=0.05)


def test_a_slow_push_moves_the_tip_as_the_frequency_response_says():
    w, count = 4 * math.pi, 20_000
    trace = simulate_link(
        LHIFAM, HAND, FILTERED, 5.0, ForceLink(), np.sin(w * 1e-3 * np.arange(count)), np.random.default_rng(0)
    )
    last = trace.t > 15
    base = np.column_stack([np.sin(w * trace.t[last]), np.cos(w * trace.t[last])])
    size = np.hypot(*np.linalg.lstsq(base, trace.tip[last], rcond=None)[0])
    response = transparency(LHIFAM, HAND, FILTERED, 5.0, np.array([w])).response
    assert size == pytest.approx(abs(response[0]), rel=1e-3)


def test_the_share_of_lost_samples_is_the_one_that_was_asked_for(rng):
    trace = simulate_link(RIGID, HAND, Feedforward(), 0.0, ForceLink(loss=0.3), np.zeros(20_000), rng)
    assert 1 - trace.arrived.mean() == pytest.approx(0.3, abs=0.02)


def test_noise_in_an_unstable_loop_is_refused():
    with pytest.raises(ParameterError, match=r"grows .* times a sample"):
        noise_felt(LHIFAM, HAND, Feedforward(), 5.0, ForceLink(noise=0.1))


def test_a_link_that_loses_everything_is_refused():
    with pytest.raises(ParameterError, match="from 0 to below 1"):
        ForceLink(loss=1.0)


def test_a_delay_of_too_many_samples_is_refused():
    with pytest.raises(ParameterError, match="give a delay of at most 53 samples"):
        mean_square_radius(LHIFAM, HAND, Feedforward(delay=0.1), 1.0, ForceLink(loss=0.1))
