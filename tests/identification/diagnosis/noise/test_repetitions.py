"""What does not repeat with a motion. Oracle: white noise of known size, closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from identification.data.log import Log
from identification.data.signals import low_pass
from identification.diagnosis.columns.one_recording_effects import Differences
from identification.diagnosis.columns.session import Session, session_of_logs
from identification.diagnosis.noise.repetitions import repetition_noise, repetitions
from phantom_dyn import load_robot
from phantom_dyn.motion import Motion
from places import ROBOTS

RATE, SIGMA, PERIOD = 100.0, np.array([0.3, 0.02]), 8.0  # [Hz], [N m], [s]


def log_of(
    seconds: float,
    period: float = PERIOD,
    start: float = 0.0,
    still: bool = False,
    rate: float = RATE,
    sway: float = 1.0,
) -> Log:
    """A motion of two waves that comes again after a period; the second joint may stand still, but for its encoder."""
    t = np.arange(0.0, seconds, 1.0 / rate)
    w = 2.0 * np.pi / period
    phase = np.stack([w * (t + start), 2.0 * w * (t + start) + 1.0], axis=1)
    speed = np.array([w, 2.0 * w])
    q, v, a = np.sin(phase) + 0.3 * np.sin(3.0 * phase), np.cos(phase), -np.sin(phase)
    v = speed * (v + 0.9 * np.cos(3.0 * phase))
    a = speed**2 * (a - 2.7 * np.sin(3.0 * phase))
    if still:
        noise = np.random.default_rng(3).standard_normal(len(t))
        q[:, 1], v[:, 1], a[:, 1] = 1e-6 * noise, 1e-5 * noise, 0.0
    motion = Motion(t, sway * q, sway * v, sway * a)
    return Log("a.csv", ("j1", "j2"), motion, np.zeros_like(q), low_pass(20.0, rate), np.ones(len(t), bool))


def session_with(*logs: Log) -> Session:
    return session_of_logs(load_robot(ROBOTS / "planar2.urdf"), logs, 20.0)


def noisy(session: Session, rng) -> tuple[np.ndarray, ...]:
    """An error of the model that repeats with the motion, and white noise."""
    parts = []
    for log in session.logs:
        q = log.motion.q[log.samples]
        parts.append(2.0 * np.sin(5.0 * q) + SIGMA * rng.standard_normal(q.shape))
    return tuple(parts)


def everywhere(residual: tuple[np.ndarray, ...]) -> tuple[np.ndarray, ...]:
    return tuple(np.ones(part.shape, bool) for part in residual)


def found(session: Session, rng) -> tuple:
    residual = noisy(session, rng)
    return repetition_noise(session, residual, everywhere(residual))


def test_a_motion_that_comes_again_shows_the_noise_and_not_the_error_of_the_model(rng):
    seen = found(session_with(log_of(4 * PERIOD)), rng)
    np.testing.assert_allclose([one.value for one in seen], SIGMA, rtol=0.1)


def test_the_stated_error_is_that_of_as_many_independent_differences(rng):
    # Closed form: the logarithm of a deviation from n samples of white noise is uncertain by 1 / sqrt(2 n).
    session = session_with(log_of(2 * PERIOD))
    (_, _, lag), *others = repetitions(session)
    assert not others
    shared = len(session.logs[0].samples) - lag
    assert found(session, rng)[0].error == pytest.approx(np.sqrt(0.5 / shared), rel=0.2)


def test_a_motion_that_does_not_come_again_shows_nothing(rng):
    assert found(session_with(log_of(0.9 * PERIOD)), rng) == (None, None)


def test_two_recordings_of_one_motion_are_compared_from_where_it_is_the_same(rng):
    session = session_with(log_of(0.9 * PERIOD), log_of(0.9 * PERIOD, start=1.0))
    step = session.logs[0].band.step
    first, second, lag = repetitions(session)[0]
    assert (first, second, lag * step) == (0, 1, -round(RATE))
    np.testing.assert_allclose([one.value for one in found(session, rng)], SIGMA, rtol=0.15)


def test_recordings_that_are_known_to_differ_are_not_compared(rng):
    session = session_with(log_of(0.9 * PERIOD), log_of(0.9 * PERIOD))
    differing = replace(session, differences=Differences(robots=(session.robot, session.robot)))
    assert found(differing, rng) == (None, None)


def test_another_motion_in_between_is_not_compared(rng):
    # A third of the samples have an error that the others do not: their motion is not the same.
    log = log_of(2 * PERIOD)
    q = np.array(log.motion.q)
    late = (log.motion.t > PERIOD) & (log.motion.t < 1.5 * PERIOD)
    q[late] += 0.5
    session = session_with(replace(log, motion=replace(log.motion, q=q)))
    np.testing.assert_allclose([one.value for one in found(session, rng)], SIGMA, rtol=0.15)


def test_a_joint_that_stands_does_not_decide_whether_the_others_repeat(rng):
    assert found(session_with(log_of(3 * PERIOD, still=True)), rng)[0].value == pytest.approx(SIGMA[0], rel=0.1)


def test_samples_that_do_not_count_say_nothing(rng):
    session = session_with(log_of(4 * PERIOD))
    residual = noisy(session, rng)
    use = everywhere(residual)
    use[0][:, 0] = False
    seen = repetition_noise(session, residual, use)
    assert seen[0] is None
    assert seen[1].value == pytest.approx(SIGMA[1], rel=0.1)


# One reference on a servo that follows it loosely: clocks differ by 0.3 %, starts by 4 ms, motions by 5 %.
LOOSELY: tuple[dict[str, float], ...] = (
    {},
    {"rate": 1.003 * RATE, "start": 0.004},
    {"rate": 1.001 * RATE, "start": -0.003, "sway": 1.05},
)


def loose_log(rate: float = RATE, start: float = 0.0, sway: float = 1.0) -> Log:
    return log_of(0.9 * PERIOD, start=start, rate=rate, sway=sway)


def slow_noise(session: Session, rng, error: float) -> tuple[np.ndarray, ...]:
    """Noise of known size below a fifth of the rate, and an error of the model that follows the motion."""
    out = []
    for log in session.logs:
        white = rng.standard_normal((len(log.samples), 2))
        smooth = np.column_stack([np.convolve(x, np.hanning(9), "same") for x in white.T])
        out.append(smooth / smooth.std(axis=0) * SIGMA + error * np.sin(log.motion.q[log.samples]))
    return tuple(out)


def counting(residual: tuple[np.ndarray, ...]) -> tuple[np.ndarray, ...]:
    return tuple(np.ones(part.shape) for part in residual)


def test_repetitions_of_a_loose_servo_show_the_noise(rng):
    session = session_with(*(loose_log(**how) for how in LOOSELY))
    residual = slow_noise(session, rng, 1.0)
    first, second = repetition_noise(session, residual, everywhere(residual), counting(residual))
    assert first is not None
    assert first.value == pytest.approx(SIGMA[0], rel=0.15)
    # A twentieth of the model's error is as large as this joint's noise.
    assert second is None


def test_loose_repetitions_are_not_compared_where_loads_differ(rng):
    session = session_with(*(loose_log(**how) for how in LOOSELY))
    differing = replace(session, differences=Differences(robots=(session.robot,) * 3))
    residual = slow_noise(session, rng, 1.0)
    assert repetition_noise(differing, residual, everywhere(residual), counting(residual)) == (None, None)


def test_a_motion_that_differs_by_a_fifth_is_no_repetition(rng):
    session = session_with(log_of(0.9 * PERIOD), log_of(0.9 * PERIOD, sway=1.25))
    residual = slow_noise(session, rng, 0.0)
    assert repetition_noise(session, residual, everywhere(residual), counting(residual)) == (None, None)
