"""Noise of torque readings above the band. Oracle: closed forms of white noise, known truths."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import csd, lfilter, welch

from identification.data.log import Band, Log
from identification.data.signals import align_held_torque, interpolated_noise, low_pass
from identification.diagnosis.noise.sensor_noise import _alignment, _densities_above_motion, torque_noise
from phantom_dyn.motion import Motion

RATE, SIGMA = 500.0, 0.3  # [Hz], [N m]


def log_of(tau: np.ndarray, raw_q: np.ndarray | None = None, band: Band | None = None) -> Log:
    still = np.zeros((len(tau), 1))
    motion = Motion(np.arange(len(tau)) / RATE, still, still, still)
    return Log("a.csv", ("j1",), motion, tau[:, None], band or low_pass(20.0, RATE), np.ones(len(tau), bool), raw_q)


@pytest.fixture
def white(rng) -> np.ndarray:
    return SIGMA * rng.standard_normal(20000)


@pytest.mark.parametrize("held", [False, True])
def test_white_noise_has_the_density_of_its_variance_over_half_the_rate(white, held):
    # Closed form: sigma^2 / (rate / 2).
    tau = align_held_torque(white[:, None])[:, 0] if held else white
    found = torque_noise((log_of(tau),), 0, held=held)
    assert found.value == pytest.approx(SIGMA**2 / (RATE / 2), rel=0.05)
    assert found.low <= found.value <= found.high < 1.3 * found.low


def test_uneven_samples_show_the_same_density(white, rng):
    # Known truth: noise of readings at uneven times, with lines drawn between them.
    times = (np.arange(len(white)) + rng.uniform(-0.4, 0.4, len(white))) / RATE
    grid = np.arange(1.0, len(white) - 1.0) / RATE
    log = replace(log_of(np.interp(grid, times, white)), noise_covariance=interpolated_noise(times, grid))
    assert torque_noise((log,), 0, held=False).value == pytest.approx(SIGMA**2 / (RATE / 2), rel=0.05)


def test_noise_that_a_recorder_has_smoothed_says_nothing(white):
    assert torque_noise((log_of(lfilter([0.4], [1.0, -0.6], white)),), 0, held=False) is None


def test_what_a_controller_answers_to_its_encoder_is_no_noise_of_the_torque(white, rng):
    # Known truth: a proportional gain on noisy readings, thirty times as much as the torque's own noise.
    q = 1e-3 * rng.standard_normal((len(white), 1))
    found = torque_noise((log_of(white - 9000.0 * q[:, 0], q),), 0, held=False)
    assert found.value == pytest.approx(SIGMA**2 / (RATE / 2), rel=0.3)


def test_a_band_that_reaches_up_to_the_rate_leaves_nothing_above(white):
    assert torque_noise((log_of(white, band=low_pass(80.0, RATE)),), 0, held=False) is None


def test_a_torque_without_noise_shows_no_density():
    assert torque_noise((log_of(np.zeros(20000)),), 0, held=False) is None


def test_several_recordings_count_by_their_length(white):
    # Closed form: of two recordings with a third and two thirds of the samples, the density is the mean so weighted.
    short, long = log_of(white[:6000]), log_of(3.0 * white[6000:18000])
    found = torque_noise((short, long), 0, held=False)
    assert found.value == pytest.approx((1.0 + 2.0 * 9.0) / 3.0 * SIGMA**2 / (RATE / 2), rel=0.07)


@pytest.mark.parametrize(("length", "cutoff_hz"), [(20000, 20.0), (6000, 10.0)])
def test_the_band_above_has_four_parts_of_equal_ratio_up_to_two_fifths_of_the_rate(white, length, cutoff_hz):
    # SciPy's Welch spectrum, in segments of an eighth of the recording and 1024 samples at most.
    tau = white[:length] + np.sin(np.arange(length))
    (levels, centres), weight = _densities_above_motion(log_of(tau, band=low_pass(cutoff_hz, RATE)), 0, held=False)
    f, power = welch(tau, RATE, nperseg=min(1024, length // 8))
    edges = np.geomspace(1.5 * cutoff_hz, 0.4 * RATE, 5)
    expected = [power[(f >= a) & (f < b)].mean() for a, b in itertools.pairwise(edges)]
    np.testing.assert_allclose(levels, expected)
    np.testing.assert_allclose(centres, np.sqrt(edges[:-1] * edges[1:]))
    assert weight == length


@pytest.mark.parametrize(("length", "segments"), [(20000, 38), (1000, 15)])
def test_what_torque_and_position_share_is_left_out_but_for_what_they_share_by_chance(white, rng, length, segments):
    # SciPy: the part of the power that the other series explains; by hand: so many half overlapping segments.
    q = rng.standard_normal((length, 1))
    tau = white[:length] + 0.5 * q[:, 0]
    (levels, _), _ = _densities_above_motion(log_of(tau, q), 0, held=False)
    options = {"fs": RATE, "nperseg": min(1024, length // 8)}
    f, power = welch(tau, **options)
    shared = np.abs(csd(tau, q[:, 0], **options)[1]) ** 2 / welch(q[:, 0], **options)[1]
    own = (power - shared) * segments / (segments - 1)
    edges = np.geomspace(30.0, 200.0, 5)
    expected = [own[(f >= a) & (f < b)].mean() for a, b in itertools.pairwise(edges)]
    np.testing.assert_allclose(levels, expected)


def test_a_position_that_does_not_move_explains_nothing(white):
    ours, theirs = (
        _densities_above_motion(log_of(white, q), 0, held=False) for q in (None, np.full((len(white), 1), 0.3))
    )
    np.testing.assert_array_equal(ours[0], theirs[0])


@pytest.mark.parametrize("share", [0.0, 0.1, 0.37])
def test_alignment_weakens_a_wave_by_its_gain(share):
    # The filter itself, on a wave that it sees whole.
    wave = np.cos(2 * np.pi * share * np.arange(2000) + 0.3)
    aligned = align_held_torque(wave[:, None])[5:-5, 0]
    other = np.sin(2 * np.pi * share * np.arange(2000) + 0.3)[5:-5]
    basis = np.column_stack([wave[5:-5], other]) if share else wave[5:-5, None]
    gain = np.linalg.norm(np.linalg.lstsq(basis, aligned, rcond=None)[0])
    assert _alignment(np.array([share])).item() == pytest.approx(gain, abs=1e-9)


@pytest.mark.parametrize(("cutoff_hz", "seen"), [(66.0, True), (67.0, False)])
def test_the_band_above_spans_an_octave_at_least(white, cutoff_hz, seen):
    # By hand: from 1.5 times the edge to 200 Hz.
    assert (torque_noise((log_of(white, band=low_pass(cutoff_hz, RATE)),), 0, held=False) is not None) is seen


def test_a_short_recording_shows_too_few_lines(white):
    # By hand: segments of 64 samples, whose lines are 7.8 Hz apart: three between 30 and 48 Hz.
    assert _densities_above_motion(log_of(white[:512]), 0, held=False) is None
    assert _densities_above_motion(log_of(white[:16]), 0, held=False) is None


@pytest.mark.parametrize(("cutoff_hz", "seen"), [(10.0, True), (9.0, False)])
def test_each_part_of_the_band_above_holds_four_lines(white, cutoff_hz, seen):
    # By hand: lines are 500 / 128 Hz apart; from 15 Hz the lowest part ends at 28.7 Hz, from 13.5
    # Hz at 26.5 Hz.
    found = _densities_above_motion(log_of(white[:1024], band=low_pass(cutoff_hz, RATE)), 0, held=False)
    assert (found is not None) is seen


@pytest.mark.parametrize(("power", "seen"), [(0.9, True), (1.1, False), (-0.9, True), (-1.1, False)])
def test_noise_may_rise_or_fall_with_the_frequency_itself(monkeypatch, power, seen):
    # By hand: levels at the middles of the parts, of which the upper two count, the densities of the law.
    centres = np.array([40.0, 60.0, 90.0, 140.0])
    monkeypatch.setattr(
        "identification.diagnosis.noise.sensor_noise._densities_above_motion",
        lambda *_, held: (np.array([[9e9, 9e9, *(centres[2:] ** power)], centres]), 1.0),
    )
    found = torque_noise((log_of(np.zeros(9)),), 0, held=False)
    assert (found is not None) is seen
    if found is not None:
        ends = sorted(centres[2:] ** power)
        assert (found.low, found.high) == pytest.approx(tuple(ends))
        assert found.value == pytest.approx(np.sqrt(ends[0] * ends[1]))
