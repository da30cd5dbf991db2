"""White noise of the torque balance above the motion. Oracle: closed forms of white noise, known truths."""

import numpy as np
import pytest

from identification.data.signals import process_all
from identification.diagnosis.noise.balance_noise import Part, balance_noise, balance_parts, between
from identification.diagnosis.noise.reading_noise import ReadingNoise

NOISE = 0.05  # of the torque at 200 Hz, as `lab.recording` adds it


def density_of(found) -> list[float]:
    return [balance_noise(parts, 2.0).value for parts in found]


@pytest.fixture
def parts_of(lab, planar2):
    def parts(torque=0.0, noise=NOISE, swing=1.5):
        motion = lab.motion(2, seconds=40.0, swing=swing)
        log, judged = process_all(
            (lab.recording(planar2, motion, torque(motion) if torque else 0.0, noise=noise),), planar2
        )
        assert judged < 10.0
        return log[0], balance_parts(planar2, log[0], judged, (ReadingNoise(1e-5, 0.0),) * 2)

    return parts


def test_white_noise_keeps_its_power_between_two_frequencies(rng):
    # Closed form: sigma^2 / (rate / 2) for every hertz.
    x = rng.standard_normal((40000, 1))
    assert np.mean(between(x, 500.0, 30.0, 50.0) ** 2) == pytest.approx(20.0 / 250.0, rel=0.05)


def test_a_slow_motion_leaves_nothing_between_higher_frequencies():
    t = np.arange(5000) / 500.0
    assert np.abs(between(np.sin(2.0 * np.pi * 0.7 * t)[:, None], 500.0, 30.0, 50.0)[500:-500]).max() < 1e-6


def test_the_density_is_that_of_the_noise_of_the_torque(parts_of):
    # Closed form: sigma^2 over half the rate.
    log, found = parts_of()
    np.testing.assert_allclose(density_of(found), 2.0 * NOISE**2 / log.band.rate_hz, rtol=0.3)


def test_friction_that_the_model_lacks_adds_little_of_it(parts_of):
    # Known truth: Coulomb friction of ten times the noise jumps at reversals only.
    log, found = parts_of(lambda motion: -0.5 * np.sign(motion.v))
    np.testing.assert_allclose(density_of(found), 2.0 * NOISE**2 / log.band.rate_hz, rtol=0.6)


def test_the_interval_holds_the_density(parts_of):
    log, found = parts_of()
    for parts in found:
        seen = balance_noise(parts, 2.8)
        assert seen.low < 2.0 * NOISE**2 / log.band.rate_hz < seen.high


def test_what_the_encoders_make_is_taken_off():
    assert Part(10.0, 4.0, 1.0, 100.0).torque == 3.0


def test_the_two_lowest_parts_are_the_noise_and_the_nearest_its_upper_end():
    # By hand: what is left of the motion raises the others.
    parts = [Part(f, level, 0.0, 1e6) for f, level in ((10.0, 9.0), (20.0, 2.0), (30.0, 1.0), (40.0, 3.0))]
    seen = balance_noise(parts, 0.0)
    assert (seen.low, seen.value, seen.high) == (1.0, 1.5, 9.0)


def test_parts_that_are_mostly_the_encoders_do_not_count():
    seen = balance_noise([Part(10.0, 2.0, 0.0, 1e6), Part(20.0, 1.0, 0.8, 1e6)], 0.0)
    assert seen.value == 2.0


def test_noise_that_the_encoders_hide_need_not_be_there_and_is_three_tenths_of_theirs_at_most():
    seen = balance_noise([Part(10.0, 1.0, 1.1, 1e6), Part(20.0, 16.0, 15.0, 1e6)], 0.0)
    assert (seen.value, seen.low, seen.high) == pytest.approx((0.0, 0.0, 0.3))


def test_without_a_part_nothing_is_known():
    assert balance_noise([], 2.0) is None


def test_a_motion_that_reaches_up_to_the_rate_leaves_no_parts(parts_of, planar2):
    log, _ = parts_of()
    assert balance_parts(planar2, log, 0.4 * log.band.rate_hz, (None, None)) == ([], [])
