"""Force feedforward over a link that is noisy and loses samples."""

import math

import numpy as np
import pytest

from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.device.axis import YOKOKOHJI_YOSHIKAWA, Operator, RigidAxis
from phantom_dyn.haptics.device.published import LHIFAM
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
from phantom_dyn.haptics.stability.force_link import (
    ForceLink,
    critical_feedforward_of_link,
    mean_square_radius,
    noise_felt,
    simulate_link,
)

RIGID = RigidAxis(5.4, 3.5)

LIGHT_HAND = Operator(0.271, 0.271, 1.355)  # the cited operator scaled to the mass that gives the printed 0.14 kg

BUTTERWORTH = Feedforward(filter=low_pass(2 * math.pi * 30, period=1e-3))


@pytest.mark.parametrize(("gain", "mass"), [(2, 1.8), (5, 0.9)])
def test_the_felt_mass_of_the_published_gains(gain, mass):
    assert felt_mass(5.4, gain) == pytest.approx(mass, rel=1e-12)


def test_hold_and_sensor_filter_leave_0_556893_at_the_nyquist_frequency():
    """Exact sampled loop of a hand that is all mass on a device without friction: gain over m_h / (m + m_h)."""
    loop = feedforward_loop(RigidAxis(5.4, 0.0), Operator(2.0, 0.0, 0.0), Feedforward())
    (gain,) = loop.gain_on_unit_circle(np.array([math.pi / 1e-3]))
    assert abs(1.0 / gain) / (2.0 / 7.4) == pytest.approx(0.556893, abs=1e-6)


@pytest.mark.parametrize(("hand", "gain", "mass"), [(YOKOKOHJI_YOSHIKAWA, 6.644, 0.706), (LIGHT_HAND, 37.57, 0.140)])
def test_critical_gain_and_the_mass_that_is_left(hand, gain, mass):
    """The printed 0.14 kg needs a hand of 0.271 kg; the cited 2 kg leave 0.706 kg."""
    result = critical_feedforward(RIGID, hand, Feedforward())
    assert result.gain == pytest.approx(gain, rel=1e-3)
    assert felt_mass(5.4, result.gain) == pytest.approx(mass, abs=5e-4)


def test_without_delay_the_phase_crosses_at_the_nyquist_frequency():
    assert critical_feedforward(RIGID, YOKOKOHJI_YOSHIKAWA, Feedforward()).frequency == math.pi / 1e-3


@pytest.mark.parametrize(
    ("milliseconds", "gain"), [(1, 5.172), (2, 4.488), (5, 3.938), (10, 3.777), (20, 3.723), (50, 3.707)]
)
def test_delay_lowers_the_critical_gain_of_the_two_kilogram_hand(milliseconds, gain):
    result = critical_feedforward(RIGID, YOKOKOHJI_YOSHIKAWA, Feedforward(delay=milliseconds * 1e-3))
    assert result.gain == pytest.approx(gain, abs=6e-4)


def test_a_millisecond_moves_the_crossing_to_227_hertz():
    result = critical_feedforward(RIGID, YOKOKOHJI_YOSHIKAWA, Feedforward(delay=1e-3))
    assert result.frequency / (2 * math.pi) == pytest.approx(227, abs=0.5)


@pytest.mark.parametrize(("hand", "gain"), [(YOKOKOHJI_YOSHIKAWA, 9.41), (Operator(0.271, 2.0, 10.0), 53.3)])
def test_a_quarter_of_a_period_raises_the_critical_gain(hand, gain):
    result = critical_feedforward(RIGID, hand, Feedforward(delay=0.25e-3))
    assert result.gain == pytest.approx(gain, rel=2e-3)
    assert result.frequency == math.pi / 1e-3


@pytest.mark.parametrize(("hand_mass", "worst"), [(2.0, 3.7), (0.271, 20.92)])
def test_worst_case_is_one_and_the_ratio_of_masses(hand_mass, worst):
    assert worst_critical_feedforward(5.4, hand_mass) == pytest.approx(worst, rel=3e-4)


def test_an_infinitely_heavy_hand_still_lets_the_mass_be_halved():
    assert felt_mass(5.4, worst_critical_feedforward(5.4, math.inf)) == pytest.approx(2.7, rel=1e-12)


@pytest.mark.parametrize(("hand", "gain"), [(YOKOKOHJI_YOSHIKAWA, 23.1), (Operator(0.271, 2.0, 10.0), 127.7)])
def test_butterworth_filter_of_30_hertz_allows_more(hand, gain):
    result = critical_feedforward(RIGID, hand, BUTTERWORTH)
    assert result.gain == pytest.approx(gain, rel=1e-3)
    assert result.frequency / (2 * math.pi) == pytest.approx(71, abs=0.6)  # close to the 82 Hz of the cable


@pytest.mark.parametrize("feedforward", [Feedforward(), Feedforward(delay=1.3e-3), BUTTERWORTH])
def test_spectral_radius_passes_one_at_the_critical_gain(feedforward):
    loop = feedforward_loop(RIGID, YOKOKOHJI_YOSHIKAWA, feedforward)
    gain = critical_feedforward(RIGID, YOKOKOHJI_YOSHIKAWA, feedforward).gain
    assert loop.spectral_radius(0.999 * gain) < 1 < loop.spectral_radius(1.001 * gain)


def test_felt_inertia_is_that_of_the_gain_at_low_frequency_and_the_bare_mass_past_the_filter():
    result = transparency(RIGID, YOKOKOHJI_YOSHIKAWA, BUTTERWORTH, 5.0, np.array([3.0, 2900.0]))
    assert result.apparent_inertia[0] == pytest.approx(0.9, rel=0.05)
    assert result.apparent_inertia[1] == pytest.approx(5.4, rel=0.05)


def test_sampled_response_is_the_ideal_one_where_nothing_is_late():
    fast = Feedforward(period=1e-7, cutoff=1e9)
    result = transparency(RIGID, YOKOKOHJI_YOSHIKAWA, fast, 2.0, np.array([1.0, 10.0, 100.0]))
    np.testing.assert_allclose(result.response, result.ideal, rtol=1e-4)


def test_ideal_response_is_equation_28_written_out():
    s = 7j
    hand = YOKOKOHJI_YOSHIKAWA
    written = 1 / (5.4 / 3 * s**2 + 3.5 / 3 * s + hand.mass * s**2 + hand.damping * s + hand.stiffness)
    ideal = transparency(RIGID, hand, Feedforward(), 2.0, np.array([7.0])).ideal
    np.testing.assert_allclose(ideal, [written], rtol=1e-12)


@pytest.mark.parametrize(("feedforward", "gain", "hertz"), [(Feedforward(), 0.700, 86.9), (BUTTERWORTH, 6.858, 66.2)])
def test_the_vibration_sets_the_limit_between_its_resonance_and_the_low_pass(feedforward, gain, hertz):
    """Values of this loop, held to it by the spectral radius; rigid it bears 6.64 and 23.1."""
    result = critical_feedforward(VIBRATING, YOKOKOHJI_YOSHIKAWA, feedforward)
    assert result.gain == pytest.approx(gain, abs=1e-3)
    assert result.frequency / (2 * math.pi) == pytest.approx(hertz, abs=0.1)
    loop = feedforward_loop(VIBRATING, YOKOKOHJI_YOSHIKAWA, feedforward)
    assert loop.spectral_radius(0.999 * result.gain) < 1 < loop.spectral_radius(1.001 * result.gain)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        pytest.param(
            lambda: critical_feedforward(RIGID, Operator(0.0, 0.0, 0.0), Feedforward()),
            "Nobody holds the device",
            id="nobody at the device",
        ),
        pytest.param(lambda: Feedforward(delay=-1.0), "delay of the feedforward is -1", id="a negative delay"),
        pytest.param(lambda: Feedforward(period=0.0), "period of the feedforward is 0", id="a period of nothing"),
        pytest.param(
            lambda: low_pass(4000.0, period=1e-3), r"below 3141\.59 rad/s", id="a cutoff past half the sampling"
        ),
        pytest.param(
            lambda: worst_critical_feedforward(5.4, 0.0),
            "give a hand's mass above 0",
            id="a hand without mass has no worst case",
        ),
        pytest.param(
            lambda: transparency(RIGID, YOKOKOHJI_YOSHIKAWA, Feedforward(), 1.0, np.zeros(1)),
            "frequencies above 0",
            id="a bode diagram at standstill",
        ),
        pytest.param(
            lambda: noise_felt(LHIFAM, HAND, Feedforward(), 5.0, ForceLink(noise=0.1)),
            r"grows .* times a sample",
            id="noise in an unstable loop",
        ),
        pytest.param(lambda: ForceLink(loss=1.0), "from 0 to below 1", id="a link that loses everything"),
        pytest.param(
            lambda: mean_square_radius(LHIFAM, HAND, Feedforward(delay=0.1), 1.0, ForceLink(loss=0.1)),
            "give a delay of at most 53 samples",
            id="a delay of too many samples",
        ),
    ],
)
def test_what_cannot_be_is_refused(call, message):
    with pytest.raises(ParameterError, match=message):
        call()


HAND = YOKOKOHJI_YOSHIKAWA

FILTER = low_pass(2 * math.pi * 30, period=1e-3)

FILTERED = Feedforward(filter=FILTER)


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
