"""The loop of a drive, read from its log. Oracle: known truth, a loop that is written here by its equation."""

from __future__ import annotations

import numpy as np
import pytest

from identification.data.drive_loop import DriveLoop, drive_loop, read_delays

T = np.arange(1500) / 100.0
GAIN, LIMIT = 24.0, 6.0


def moving(t: np.ndarray) -> np.ndarray:
    return 0.8 * np.sin(2 * np.pi * 0.3 * t) + 0.4 * np.sin(2 * np.pi * 0.8 * t + 1.0)


@pytest.fixture
def q() -> np.ndarray:
    """A joint that trails its reference by a tenth of a second."""
    return 0.9 * moving(T - 0.1)


def loop_of(q: np.ndarray, y: np.ndarray) -> DriveLoop:
    found = drive_loop("u", T, y, moving(T), q)
    assert found is not None
    return found


@pytest.mark.parametrize("delay", [0.013, 0.03, 0.0555])
def test_gain_and_delay_are_those_of_the_loop(q, delay, rng):
    y = GAIN * (moving(T - delay) - q) + 0.1 * rng.standard_normal(len(T))
    found = loop_of(q, y)
    assert found.gain == pytest.approx(GAIN, abs=3 * found.gain_std + 0.01)
    assert found.delay == pytest.approx(delay, abs=3 * found.delay_std)
    assert found.delay_std < 0.003
    assert not found.computed


def test_rows_at_the_limit_are_censored(q, rng):
    y = GAIN * (moving(T - 0.03) - q)
    found = loop_of(q, np.clip(y + 0.05 * rng.standard_normal(len(T)), -LIMIT, LIMIT))
    assert found.limit == pytest.approx(LIMIT)
    assert found.at_limit == pytest.approx(np.mean(np.abs(y) > LIMIT), abs=0.02)
    assert found.gain == pytest.approx(GAIN, rel=0.01)
    assert found.delay == pytest.approx(0.03, abs=0.001)


def test_the_peaks_of_an_output_are_no_limit(q):
    # Of a hundred samples a second more than one in a hundred are within a per cent of the largest.
    y = GAIN * (moving(T - 0.03) - q)
    assert np.mean(np.abs(y) > 0.985 * np.abs(y).max()) > 0.01
    assert loop_of(q, y).limit is None


def test_an_output_up_to_rounding_was_computed(q):
    found = loop_of(q, np.round(GAIN * (moving(T) - q), 3))
    assert found.computed
    assert found.delay == 0.0


def test_a_late_loop_without_noise_was_not_computed_from_the_reference(q):
    assert not loop_of(q, GAIN * (moving(T - 0.03) - q)).computed


def protected(q: np.ndarray, beyond: float = 0.2, most: float = 1.2) -> np.ndarray:
    """Output of a loop that puts out no more than ``most`` beyond an error."""
    error = moving(T - 0.03) - q
    return np.where(np.abs(error) > beyond, np.clip(GAIN * error, -most, most), GAIN * error)


def test_a_drive_that_protects_itself_has_its_error_and_its_output(q, rng):
    found = loop_of(q, protected(q) + 0.02 * rng.standard_normal(len(T)))
    assert found.drops_beyond == pytest.approx(0.2, rel=0.03)
    assert found.drops_to == pytest.approx(1.2, rel=0.03)
    assert found.dropped == pytest.approx(np.mean(np.abs(moving(T - 0.03) - q) > 0.2), abs=0.01)
    assert found.gain == pytest.approx(GAIN, rel=0.01)
    assert found.delay == pytest.approx(0.03, abs=0.001)


def test_its_law_is_that_of_the_loop(q):
    found = loop_of(q, protected(q))
    np.testing.assert_allclose(found.put_out(moving(T - 0.03) - q), protected(q), atol=0.02)


def test_a_limit_is_no_protection(q, rng):
    y = np.clip(GAIN * (moving(T - 0.03) - q) + 0.05 * rng.standard_normal(len(T)), -LIMIT, LIMIT)
    assert loop_of(q, y).dropped == 0.0


def test_bad_readings_are_no_protection(q):
    bad = q.copy()
    bad[100::90] = -np.pi
    assert loop_of(bad, GAIN * (moving(T - 0.03) - q)).dropped == 0.0


def test_a_dead_band_is_the_error_below_which_nothing_is_put_out(q):
    error = moving(T - 0.03) - q
    found = loop_of(q, np.where(np.abs(error) < 0.06, 0.0, GAIN * error))
    assert found.dead_band == pytest.approx(0.06, rel=0.1)


def test_without_a_dead_band_none_is_stated(q):
    assert loop_of(q, GAIN * (moving(T - 0.03) - q)).dead_band is None


def test_a_reference_that_is_repeated_is_held(q):
    held = moving(np.floor(T * 25.0 + 1e-9) / 25.0)
    found = drive_loop("u", T, GAIN * (held - q), held, q)
    assert found is not None
    assert found.hold == pytest.approx(0.04, rel=0.02)


def test_an_output_that_does_not_follow_the_error_has_no_loop(q, rng):
    assert drive_loop("tau", T, np.sin(7 * T) + rng.standard_normal(len(T)), moving(T), q) is None


def test_single_bad_readings_do_not_move_the_gain(q, rng):
    bad = q.copy()
    bad[[300, 900]] = -np.pi
    found = loop_of(bad, GAIN * (moving(T - 0.03) - q) + 0.05 * rng.standard_normal(len(T)))
    assert found.gain == pytest.approx(GAIN, rel=0.01)


def test_the_interval_of_the_delay_covers_it(q):
    # Deviations are of a jackknife: over noise that lasts for ten samples, three of them cover nearly always.
    inside = 0
    for seed in range(40):
        noise = np.convolve(np.random.default_rng(seed).standard_normal(len(T) + 9), np.ones(10) / 10, "valid")
        found = loop_of(q, GAIN * (moving(T - 0.03) - q) + noise)
        least, most = read_delays((found,), 1)
        inside += least[0] <= 0.03 <= most[0]
    assert inside >= 38


def test_a_held_reference_came_up_to_a_frame_earlier(q):
    found = loop_of(q, GAIN * (moving(T - 0.03) - q))
    (least,), (most,) = read_delays((found,), 1, frame=0.01)
    assert least < 0.0201
    assert most == pytest.approx(0.03, abs=0.003)


def test_a_computed_output_says_nothing_of_the_delay(q):
    least, most = read_delays((loop_of(q, GAIN * (moving(T) - q)),), 1)
    assert (least[0], most[0]) == (0.0, np.inf)
