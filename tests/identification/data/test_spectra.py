import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from identification.data.signals import _driven_edge
from phantom_dyn.signals.band_edges import (
    _acceleration_spectrum,
    _edge_above_encoder_noise,
    _edge_above_floor,
    _sixth_octaves,
    _welch,
    acceleration_edge,
    driven_edge,
    slow_motion_edge,
    torque_edge,
)

RATE = 500.0
T = np.arange(round(20 * RATE)) / RATE


def swinging(rng: np.random.Generator, top_hz: float) -> np.ndarray:
    """Positions with content up to a known frequency, flat in acceleration."""
    f = np.arange(0.2, top_hz, 0.2)
    phase = rng.uniform(0, 2 * np.pi, len(f))
    return (np.cos(2 * np.pi * np.outer(T, f) + phase) / f**2).sum(axis=1)


@pytest.mark.parametrize(("top_hz", "noise"), [(5.0, 1e-3), (12.0, 1e-3), (30.0, 1e-4)])
def test_the_acceleration_of_a_joint_ends_where_its_motion_ends(rng, top_hz, noise):
    # Known truth: content up to top_hz, then white noise of the position; bins and envelope are half an octave wide.
    q = swinging(rng, top_hz) + noise * rng.normal(size=len(T))
    edge = acceleration_edge(q, RATE)
    assert edge is not None
    assert 0.8 * top_hz < edge < 1.6 * top_hz


def test_a_joint_at_rest_has_no_edge(rng):
    assert acceleration_edge(1e-4 * rng.normal(size=len(T)), RATE) is None


def test_a_joint_that_never_moves_has_no_edge():
    assert acceleration_edge(np.full(len(T), 0.3), RATE) is None


@pytest.mark.parametrize("samples", range(4, 11))
def test_a_handful_of_samples_has_no_edge(samples):
    # Closed form: three periods of up to eight second differences are no less than 0.375 of the rate, and from there
    # to 0.4 of it there is no sixth of an octave.
    assert acceleration_edge(np.sin(np.arange(float(samples))), RATE) is None


def test_a_coarser_encoder_lowers_the_edge(rng):
    f = np.arange(0.2, 60.0, 0.2)
    phase = rng.uniform(0, 2 * np.pi, len(f))
    q = (np.cos(2 * np.pi * np.outer(T, f) + phase) / f**4).sum(axis=1)
    edges = [acceleration_edge(np.round(q / step) * step, RATE) or 0.0 for step in (1e-5, 1e-3, 1e-1)]
    assert edges[0] > 1.5 * edges[1] > 1.5**2 * edges[2] > 0


def test_the_torque_of_a_recorder_that_smooths_ends_at_its_filter(rng):
    # Known truth: an eighth-order low pass at 40 Hz leaves 1 % of the amplitude within an octave.
    tau = sosfiltfilt(butter(8, 40.0, fs=RATE, output="sos"), rng.normal(size=len(T)))
    assert 40.0 < torque_edge(tau, RATE) < 60.0


@pytest.mark.parametrize(("amplitude", "edge"), [(0.03, 80.5), (0.011, 80.0), (0.009, 10.75)])
def test_the_torque_ends_where_a_hundredth_of_its_amplitude_is_left(amplitude, edge):
    # Closed form: by the coefficients 0.42, 0.25 and 0.04 of Blackman's window, a line at a multiple of 0.25 Hz has
    # power 0.1764 there, 0.0625 in the bins beside it and 0.0016 in the next ones. Of a hum with 1.21e-4 of the power
    # a share of 0.79 lies at its line and above; of one with 9e-4, 0.21 lies one bin above and 0.0053 two.
    tau = np.sin(2 * np.pi * 10.0 * T) + amplitude * np.sin(2 * np.pi * 80.0 * T)
    assert torque_edge(tau, RATE) == edge


def test_white_torque_reaches_half_the_rate(rng):
    assert torque_edge(rng.normal(size=len(T)), RATE) == pytest.approx(0.5 * RATE, rel=0.01)


def test_no_torque_has_no_band():
    assert torque_edge(np.zeros(len(T)), RATE) == 0.0


def ramps(amplitude: float, hz: float) -> np.ndarray:
    """A triangle wave of a position."""
    return amplitude * (2 / np.pi) * np.arcsin(np.sin(2 * np.pi * hz * T))


@pytest.mark.parametrize("noise", [5e-4, 1e-3, 3e-3])
def test_the_edge_of_ramps_is_where_the_noise_of_the_encoder_takes_over(rng, noise):
    # Closed form: a triangle wave has acceleration lines of 32 A f^2 every 2 f, a flat density of (32 A f^2)^2 / (4 f);
    # white noise of the position has 2 s^2 / rate (2 pi f)^4. Where they sum to ten times the noise is the edge.
    amplitude, hz = 0.5, 0.4
    flat = (32 * amplitude * hz**2) ** 2 / (4 * hz)
    expected = (flat * RATE / (18 * noise**2)) ** 0.25 / (2 * np.pi)
    edge = acceleration_edge(ramps(amplitude, hz) + noise * rng.normal(size=len(T)), RATE)
    assert edge == pytest.approx(expected, rel=0.3)


def test_a_spectrum_that_does_not_rise_like_that_of_an_encoder_has_no_edge(rng):
    # White acceleration, twice integrated: nothing tells its end.
    assert acceleration_edge(np.cumsum(np.cumsum(1e-5 * rng.normal(size=len(T)))), RATE) is None


@pytest.mark.parametrize("noise", [0.002, 0.005, 0.01])
def test_noise_is_a_hundredth_of_a_slow_motion_up_to_its_edge(rng, noise):
    # Closed form: the acceleration of x = sin(2 pi t) has the power (2 pi)^4 / 2, that of white noise of the position
    # below f has 2 noise^2 / rate (2 pi)^4 f^5 / 5.
    rate_hz = 300.0
    t = np.arange(0.0, 4.0, 1.0 / rate_hz)
    q = np.sin(2 * np.pi * t) + noise * rng.normal(size=len(t))
    assert acceleration_edge(q, rate_hz) is None
    expected = (0.01 * 0.5 * 5 * rate_hz / (2 * noise**2)) ** 0.2
    assert slow_motion_edge(q, rate_hz) == pytest.approx(expected, rel=0.2)


@pytest.mark.parametrize("q", [np.zeros(1200), np.arange(1200.0), np.ones(5)])
def test_a_joint_that_does_not_accelerate_has_no_edge_of_a_slow_motion(q):
    assert slow_motion_edge(q, 300.0) is None


def test_the_noise_of_a_joint_at_rest_is_no_slow_motion(rng):
    assert slow_motion_edge(rng.normal(size=1200), 300.0) is None


def lines(*hz: float) -> np.ndarray:
    return sum(np.sin(2 * np.pi * f * T) for f in hz)


def test_the_drive_ends_below_the_lowest_third_octave_in_which_the_model_alone_moves():
    # By hand: thirds of an octave down from 40 Hz end at 31.7, 25.2, 20, 15.9, 12.6 and 10 Hz. Up to 12.6 Hz both have
    # a line; the model alone has one in each above.
    edge = driven_edge(lines(5.0, 11.0), lines(5.0, 11.0, 14.0, 18.0, 22.0, 28.0, 36.0), RATE, 40.0)
    assert edge == pytest.approx(40.0 / 2 ** (5 / 3))


def test_a_drive_that_moves_what_is_at_the_top_has_no_end():
    # A line at the top is driven, whatever lies below it.
    assert driven_edge(lines(5.0, 36.0), lines(5.0, 14.0, 36.0), RATE, 40.0) == np.inf


@pytest.mark.parametrize(("share", "driven"), [(0.6, False), (0.8, True)])
def test_a_torque_of_half_the_power_that_the_model_needs_drives_it(share, driven):
    # Closed form: shares of amplitude of 0.6 and 0.8 are 0.36 and 0.64 of the power.
    assert (driven_edge(share * lines(36.0), lines(36.0), RATE, 40.0) == np.inf) is driven


def test_what_no_drive_moves_is_followed_down_to_two_hertz():
    # By hand: 16, 12.7, ..., 2.52, 2.0: the last third that begins above 2 Hz ends there.
    f = 16.0 / 2 ** (np.arange(9) / 3) * 0.9
    assert driven_edge(1e-3 * lines(*f), lines(*f), RATE, 16.0) == pytest.approx(2.0)


def test_a_robot_has_the_median_end_of_its_moving_joints_on_the_longest_recording(pendulum):
    # Known truth: a hum of 12 Hz that the torque knows nothing of; at rest nothing is moved, so nothing ends.
    still = np.zeros((len(T), 1))
    swing = 0.5 * np.sin(2 * np.pi * 1.0 * T)[:, None]
    model = -1.1 * (2 * np.pi) ** 2 * swing
    hum = 2e-3 * np.sin(2 * np.pi * 12.0 * T)[:, None]
    assert 1.0 < _driven_edge(pendulum, [(swing + hum, model, RATE), (still[:900], still[:900], RATE)], 15.0) < 12.0
    assert _driven_edge(pendulum, [(still, still, RATE)], 15.0) == np.inf


@pytest.mark.parametrize(
    ("samples", "rate_hz", "length"), [(50_000, 100.0, 400), (1500, 100.0, 300), (1000, 100.0, 256), (200, 100.0, 200)]
)
def test_a_segment_lasts_four_seconds_or_a_fifth_and_has_256_samples_at_least(samples, rate_hz, length):
    assert _welch(np.ones(samples), rate_hz)[2] == length


def test_a_constant_has_no_power():
    assert not np.any(_welch(np.full(2000, 3.0), RATE)[1] > 1e-20)


@pytest.mark.parametrize("hz", [2.0, 60.0, 180.0])
def test_the_spectrum_of_an_acceleration_has_the_power_of_a_sine_s_second_derivative(hz):
    # Closed form: (2 pi f)^4 / 2 in a line, also where second differences take two thirds off. Without the fourth power
    # of the frequencies beside it, the window's side lines add a part that falls with frequency.
    f, power, length = _acceleration_spectrum(0.1 * np.sin(2 * np.pi * hz * T), RATE)
    assert length == 1999
    assert power.sum() * f[1] == pytest.approx(0.5 * (0.1 * (2 * np.pi * hz) ** 2) ** 2, rel=0.05 if hz < 10 else 0.005)
    assert power[0] == pytest.approx(0.0, abs=1e-6 * power.max())


def test_bins_are_a_sixth_of_an_octave_wide():
    # By hand: from 8 to 32 Hz there are twelve; each has the mean of what lies in it.
    f = np.arange(0.0, 60.0, 0.01) + 0.005
    centre, level = _sixth_octaves(f, np.log2(f), 8.0, 32.5)
    np.testing.assert_allclose(centre, 8.0 * 2.0 ** ((np.arange(12) + 0.5) / 6))
    np.testing.assert_allclose(level, 3.0 + (np.arange(12) + 0.5) / 6, atol=0.002)


def test_bins_without_a_line_are_left_out():
    # By hand: 8 lies in the first bin, from 8 to 8.98, and 10 in the second one, from 8.98 to 10.08; 11 in the third.
    centre, level = _sixth_octaves(np.array([7.9, 8.0, 10.0, 12.0]), np.array([9.0, 1.0, 2.0, 3.0]), 8.0, 17.0)
    np.testing.assert_allclose(centre, 8.0 * 2.0 ** (np.array([0.5, 1.5, 3.5]) / 6))
    np.testing.assert_array_equal(level, [1.0, 2.0, 3.0])


# Bins a quarter of an octave wide, so that a third of an octave reaches to the neighbours: a peak, a fall, a floor.
QUARTERS = 2.0 ** (np.arange(12) / 4)


def spectrum(*level: float) -> np.ndarray:
    return np.array(level, dtype=float)


def test_the_edge_is_the_first_bin_whose_neighbours_are_all_within_ten_decibels_of_the_floor():
    # By hand: the floor is 1; 10 counts as within 10 dB, 11 does not. Bins 3 and 4 have a neighbour of 1000 or 11.
    level = spectrum(20, 1000, 1000, 11, 10, 10, 10, 1, 1, 1, 30, 90)
    assert _edge_above_floor(QUARTERS, level) == QUARTERS[5]
    level = spectrum(20, 1000, 1000, 11, 11, 10, 10, 1, 1, 1, 30, 90)
    assert _edge_above_floor(QUARTERS, level) == QUARTERS[6]


@pytest.mark.parametrize(("bump", "edge"), [(39.0, 10), (41.0, 4)])
def test_the_floor_lies_before_the_spectrum_rises_by_thirteen_decibels(bump, edge):
    # By hand: behind a bump of less than twenty times the floor of 2 it is the later one of 0.1.
    level = spectrum(20, 1000, 1000, 2, 2, 2, bump, 3, 3, 0.1, 0.1, 0.1)
    assert _edge_above_floor(QUARTERS, level) == QUARTERS[edge]


@pytest.mark.parametrize(("peak", "edge"), [(249.0, None), (251.0, 4)])
def test_a_peak_has_250_times_the_power_of_the_floor(peak, edge):
    level = spectrum(20, 100, peak, 1, 1, 1, 1, 1, 1, 1, 1, 1)
    assert _edge_above_floor(QUARTERS, level) == (None if edge is None else QUARTERS[edge])


def test_what_lies_below_the_fastest_velocity_is_no_floor():
    # By hand: over the square of the frequency bin 4 is the largest, and the lowest bins lie before it.
    level = spectrum(1e-3, 1e-3, 1e-3, 400, 1600, 1600, 1, 1, 1, 1, 1, 1)
    assert _edge_above_floor(QUARTERS, level) == QUARTERS[7]


RAMPS = 10.0 * 2.0 ** (np.arange(30) / 6)  # from 10 to 285 Hz


def test_encoder_noise_takes_over_where_it_has_a_tenth_of_the_power():
    # Closed form: a flat spectrum of s and a noise of n f^4 come to ten times the noise at f^4 = s / (9 n).
    flat = 9.0 * 30.0**4
    for unit in (1.0, 1e-12):
        assert _edge_above_encoder_noise(RAMPS, unit * (flat + RAMPS**4), 500.0) == RAMPS[RAMPS < 30.0][-1]


@pytest.mark.parametrize(("slope", "known"), [(2.4, False), (2.6, True)])
def test_noise_of_an_encoder_rises_at_least_with_frequency_to_the_power_of_two_and_a_half(slope, known):
    # Power laws above 50 Hz, a tenth of the rate; a strong motion below.
    level = np.where(RAMPS < 50.0, 1e3, 1.0) * RAMPS**slope
    assert (_edge_above_encoder_noise(RAMPS, level, 500.0) is not None) is known


def test_two_bins_above_a_tenth_of_the_rate_show_no_slope():
    # The same spectrum at a rate at which all bins but two, or three, lie below its tenth.
    flat = RAMPS**4 + 9.0 * 30.0**4
    assert _edge_above_encoder_noise(RAMPS, flat, 10.0 * RAMPS[-3]) is None
    assert _edge_above_encoder_noise(RAMPS, flat, 10.0 * RAMPS[-4]) == RAMPS[RAMPS < 30.0][-1]


@pytest.mark.parametrize(("bins", "edge"), [(2, None), (3, RAMPS[2])])
def test_motion_has_three_bins_above_the_noise_at_least(bins, edge):
    level = RAMPS**4 * np.where(np.arange(30) < bins, 11.0, 1.0)
    assert _edge_above_encoder_noise(RAMPS, level, 500.0) == edge


def test_what_lies_above_two_fifths_of_the_rate_is_not_looked_at(rng):
    # The noise ends at 0.42 of the rate, as behind the filter of a recorder: a floor without any noise is none.
    q = swinging(rng, 12.0)
    noise = 1e-3 * rng.normal(size=len(T))
    left = sosfiltfilt(butter(12, 0.84, output="sos"), noise)
    assert acceleration_edge(q + left, RATE) == acceleration_edge(q + noise, RATE)
