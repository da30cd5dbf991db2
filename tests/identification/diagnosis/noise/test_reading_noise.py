"""How positions are read. Oracle: closed forms of white noise and of rounding, known truths."""

import numpy as np
import pytest

from identification.data.log import Log
from identification.data.signals import low_pass
from identification.diagnosis.noise.reading_noise import ReadingNoise, reading_noise, white_part
from phantom_dyn.motion import Motion

RATE, COUNT = 500.0, 10000
T = np.arange(COUNT) / RATE
EVERY = np.ones(COUNT, dtype=bool)


def log_of(q: np.ndarray, raw: np.ndarray | None, step: float | None = None) -> Log:
    zero = np.zeros((COUNT, 1))
    motion = Motion(T, q[:, None], zero, zero)
    raw_q = None if raw is None else raw[:, None]
    return Log("a.csv", ("j1",), motion, zero, low_pass(20.0, RATE), EVERY, raw_q, reading_steps=(step,))


@pytest.fixture
def swing() -> np.ndarray:
    return np.sin(2.0 * np.pi * 0.7 * T)


def test_the_white_part_is_the_noise_that_was_added_to_a_smooth_motion(swing, rng):
    # Known truth: 1e-5 on a swing of a radian.
    assert white_part(swing + 1e-5 * rng.standard_normal(COUNT), EVERY) == pytest.approx(1e-5, rel=0.05)


def test_readings_that_must_not_be_used_do_not_count(swing, rng):
    readings = swing + 1e-5 * rng.standard_normal(COUNT)
    valid = EVERY.copy()
    readings[4000:4100], valid[4000:4100] = 1.0, False
    assert white_part(readings, valid) == pytest.approx(1e-5, rel=0.05)


def test_readings_of_which_none_may_be_used_have_no_noise():
    assert white_part(np.ones(20), np.zeros(20, dtype=bool)) == 0.0


def test_readings_on_no_lattice_are_white(swing, rng):
    found = reading_noise(log_of(swing, swing + 1e-5 * rng.standard_normal(COUNT)), 0)
    assert found.step == 0.0
    assert found.white == pytest.approx(1e-5, rel=0.05)


def test_a_rounded_motion_holds_no_noise_beside_its_rounding(swing):
    step = 1e-4
    found = reading_noise(log_of(swing, np.round(swing / step) * step, step), 0)
    assert found.step == step
    assert found.white < 0.3 * step / np.sqrt(12.0)


def test_noise_before_the_rounding_is_seen_beside_it(swing, rng):
    step, white = 1e-4, 1e-4
    readings = np.round((swing + white * rng.standard_normal(COUNT)) / step) * step
    assert reading_noise(log_of(swing, readings, step), 0).white == pytest.approx(white, rel=0.1)


def test_a_lattice_that_the_readings_do_not_keep_to_is_none(swing, rng):
    # Known truth: noise of 1e-6, far finer than the lattice that is claimed.
    found = reading_noise(log_of(swing, swing + 1e-6 * rng.standard_normal(COUNT), 0.05), 0)
    assert found.step == 0.0


def test_where_nobody_kept_the_readings_nothing_is_known(swing):
    assert reading_noise(log_of(swing, None), 0) is None


def test_rounding_of_a_fast_motion_errs_by_a_step_over_the_root_of_twelve(swing, rng):
    # Closed form: evenly distributed over a step.
    assert ReadingNoise(0.0, 1e-4).errors(swing, rng).std() == pytest.approx(1e-4 / np.sqrt(12.0), rel=0.03)


def test_the_error_of_a_joint_at_rest_stays(rng):
    # A joint that does not move is read at one level.
    assert np.ptp(ReadingNoise(0.0, 1e-4).errors(np.full(100, 0.3), rng)) < 1e-12
