"""Expected size of a residual. Oracle: known truth, normal numbers of a known deviation at each sample."""

import numpy as np
import pytest

from identification.diagnosis.judge.bursts import Causes, _variance, expected_error, moving_torque

N = 4000
FOLD = np.arange(N) * 8 // N
ALL = np.ones(N, dtype=bool)
QUIET = np.zeros(N)
NEVER = np.zeros(N, dtype=bool)
TORQUE = 3.0 * (1 + np.sin(np.arange(N) / 37.0))


def drawn(variance: np.ndarray) -> np.ndarray:
    return np.sqrt(variance) * np.random.default_rng(1).standard_normal(N)


def test_noise_alone_is_expected_everywhere():
    expected = expected_error(drawn(np.full(N, 0.04)), Causes(QUIET, QUIET, NEVER), ALL, FOLD)
    np.testing.assert_allclose(expected, 0.2, rtol=0.08)


def test_a_share_of_the_torque_is_read_off_the_residual():
    variance = 0.01**2 + (0.02 * TORQUE) ** 2
    expected = expected_error(drawn(variance), Causes(QUIET, TORQUE**2, NEVER), ALL, FOLD)
    high = TORQUE > 4
    np.testing.assert_allclose(expected[high], np.sqrt(variance)[high], rtol=0.35)


def test_a_model_is_wrong_by_a_thousandth_of_unusual_torques_at_least():
    # By hand: 3000 N m are usual, so of 6000 N m it is the thousandth of what that is more, in squares.
    torque = np.where(np.arange(N) % 100 < 20, 6000.0, 3000.0)
    expected = expected_error(drawn(np.full(N, 1e-12)), Causes(QUIET, torque**2, NEVER), ALL, FOLD)
    np.testing.assert_allclose(expected[torque > 5000], np.sqrt(6.0**2 - 3.0**2), rtol=1e-3)


def test_events_are_not_taken_for_an_error_that_grows_with_the_torque():
    # A fifth of the samples is off by fifteen deviations, whatever the torque is.
    residual = drawn(np.ones(N)) + 15.0 * (np.random.default_rng(5).random(N) < 0.2)
    expected = expected_error(residual, Causes(QUIET, (10 * TORQUE) ** 2, NEVER), ALL, FOLD)
    assert np.all(expected < 3.0)


def test_what_reversals_leave_is_expected_at_the_next_one():
    reversals = np.arange(N) % 200 < 10
    residual = drawn(np.where(reversals, 25.0, 1.0))
    expected = expected_error(residual, Causes(QUIET, QUIET, reversals), ALL, FOLD)
    assert np.median(expected[reversals]) == pytest.approx(5.0, rel=0.35)
    assert np.median(expected[~reversals]) == pytest.approx(1.0, rel=0.1)


def test_what_is_known_beforehand_is_added():
    known = np.where(np.arange(N) % 500 < 20, 100.0, 0.0)
    expected = expected_error(drawn(np.ones(N)), Causes(known, QUIET, NEVER), ALL, FOLD)
    np.testing.assert_allclose(expected[known > 0], np.sqrt(101.0), rtol=0.01)


def test_an_event_does_not_make_what_is_expected_of_it():
    # A push at the only moment of large torque: no other fold shows that torque, so nothing speaks for an error there.
    torque = np.where((np.arange(N) > 2010) & (np.arange(N) < 2100), 5.0, 1.0)
    residual = drawn(np.ones(N)) + 40.0 * (torque > 2)
    expected = expected_error(residual, Causes(QUIET, torque**2, NEVER), ALL, FOLD)
    assert np.all(expected[torque > 2] < 4.0)


def test_events_in_a_fifth_of_the_time_hardly_raise_it():
    residual = drawn(np.ones(N)) + 15.0 * (np.arange(N) % 500 < 100)
    expected = expected_error(residual, Causes(QUIET, QUIET, NEVER), ALL, FOLD)
    assert np.all(expected < 1.4)


def test_samples_that_may_not_be_used_say_nothing():
    use = np.arange(N) % 2 == 0
    residual = np.where(use, drawn(np.ones(N)), 1e6)
    assert np.all(expected_error(residual, Causes(QUIET, QUIET, NEVER), use, FOLD) < 1.2)


def test_the_moving_torque_is_about_its_median_and_holds_its_peaks():
    # Closed form: a sine of 2 N m at half the edge of the band, about 7 N m: its change has half its size.
    t = np.arange(0, 10, 0.01)
    moving = moving_torque(7 + 2 * np.sin(2 * np.pi * 2.5 * t), 100.0, 5.0)
    inside = slice(50, -50)
    np.testing.assert_allclose(moving[inside], 4.0, rtol=0.02)
    assert not moving_torque(np.full(500, 7.0), 100.0, 5.0).any()


def split(count: int, many: int, others: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Residuals of a first fold of so many samples of one, and of a second fold with another size."""
    fold = (np.arange(count) < many).astype(int)
    return np.where(fold == 1, 1.0, others), np.ones(count, dtype=bool), fold


@pytest.mark.parametrize(("samples", "other"), [(19, 1.0), (20, 5.0)])
def test_twenty_samples_of_other_folds_are_enough_to_judge_by(samples, other):
    # Closed form: noise is the median square over that of a normal number; with fewer all samples judge, most are one.
    residual, use, fold = split(200 + samples, 200, 5.0)
    none = np.zeros(len(residual))
    found = expected_error(residual, Causes(none, none, none > 0), use, fold)
    np.testing.assert_allclose(found[:200], other / np.sqrt(0.4549), rtol=0.02)
    np.testing.assert_allclose(found[200:], 1.0 / np.sqrt(0.4549), rtol=0.02)


@pytest.mark.parametrize(("calm", "noise"), [(19, 3.0), (20, 1.0)])
def test_twenty_calm_samples_are_enough_to_read_the_noise(calm, noise):
    # By hand: calm are samples up to the median of both causes; half of them has much torque, nearly the others much
    # doubt.
    torque = np.repeat([0.0, 10.0], 100)
    known = np.concatenate([np.zeros(calm), np.full(100 - calm, 7.0), np.zeros(100)])
    residual = np.where(torque + known > 0, 3.0, 1.0)
    found = _variance(residual, Causes(known, torque, torque < 0), np.ones(200, dtype=bool))
    assert found[0] == pytest.approx(noise**2 / 0.4549, rel=0.02)


def test_samples_with_the_usual_torque_and_doubt_are_calm():
    # By hand: the same torque and doubt everywhere; only the samples that may be used count.
    residual = np.where(np.arange(100) < 60, 2.0, 9.0)
    causes = Causes(np.full(100, 5.0), np.full(100, 4.0), np.zeros(100, dtype=bool))
    found = _variance(residual, causes, np.arange(100) < 60)
    np.testing.assert_allclose(found, 4.0 / 0.4549 + 5.0, rtol=0.02)
