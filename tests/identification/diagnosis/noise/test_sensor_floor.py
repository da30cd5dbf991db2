"""The noise floor of the sensors. Oracle: the noisy less the clean record of the same run, known truths."""

from dataclasses import replace
from itertools import accumulate

import numpy as np
import pytest

from identification.data.signals import process
from identification.diagnosis.columns.motion.standstill import usable_samples
from identification.diagnosis.columns.residual_columns import FitPoint, build_columns
from identification.diagnosis.columns.session import session_of
from identification.diagnosis.noise.sensor_floor import (
    _mean_density,
    _smaller_density,
    joints_with_rising_noise,
    sensed_noise,
    sensor_floor,
)
from identification.diagnosis.noise.sensor_noise import Density
from phantom_dyn.dynamics.dynamics import inverse_dynamics, modelled_friction

LAG = 0.97  # at 200 Hz: a corner at 1 Hz
WITHIN = 1.25  # the measured ratio of seeds; the goal of the method is 1.2 for 95 % of the joints


def balance(robot, log):
    return log.tau - inverse_dynamics(robot, log.motion) + modelled_friction(robot, log.motion)


def floors(session):
    return sensor_floor(session, tuple(usable_samples(log).astype(float) for log in session.logs))


@pytest.fixture
def made(lab, planar2):
    """A session and the true floor: the noisy record's balance less the clean one's, in the judged band."""

    def make(*, noise=0.05, robot=planar2, acting=0.0, encoder=0.0, lagging=0.0, seed=0):
        motion = lab.motion(2, seconds=40.0, swing=1.5)
        torque = acting * -np.sign(motion.v)
        recording = lab.recording(robot, motion, torque, noise=noise, seed=seed)
        rough = np.random.default_rng(seed).normal(size=motion.q.shape) * encoder
        slow = behind_lag(np.random.default_rng(seed + 1).normal(size=motion.q.shape), LAG) * lagging
        recording = replace(recording, q=recording.q + rough, tau=recording.tau + slow)
        session = session_of(robot, (recording,))
        log = session.logs[0]
        clean = replace(recording, q=motion.q, tau=inverse_dynamics(robot, motion) - torque)
        clean = process(clean, robot, cutoff_hz=log.band.cutoff_hz)
        error = session.log_in_judged_band(log.band(balance(robot, log) - balance(robot, clean)), 0)
        use = usable_samples(log)
        return session, np.sqrt(np.sum(np.where(use, error, 0.0) ** 2, axis=0) / use.sum(axis=0))

    return make


def behind_lag(white, share):
    """White noise behind a lag of first order, with its deviation; ``share``: of each sample in the next one."""
    gain = np.sqrt(1.0 - share**2)
    return np.array(list(accumulate(gain * white, lambda before, new: share * before + new)))


def ratio(made, **kwargs):
    session, true = made(**kwargs)
    found = floors(session)
    return np.maximum(found.value / true, true / found.value)


@pytest.mark.parametrize("source", ["command", "current"])
def test_noise_of_the_torque_makes_the_floor_that_the_clean_record_shows(made, planar2, source):
    assert np.all(ratio(made, robot=replace(planar2, torque_source=source)) < WITHIN)


def test_noise_of_the_encoders_begins_the_interval_in_which_that_of_the_torque_may_be_hidden(made):
    # Known truth: there is no noise but that of the encoders, which hides how much of the torque there is.
    session, true = made(noise=0.0, encoder=3e-4)
    found = floors(session)
    np.testing.assert_allclose(found.low, true, rtol=WITHIN - 1.0)
    assert np.all(found.value <= 0.3 * found.high)


def test_what_readings_show_counts_up_to_the_limit_where_encoders_hide_the_noise_of_the_balance():
    # Closed form. On a simulated arm with 16 bits the value was a tenth of the noise that its readings have.
    hidden = Density(0.25, 0.0, 4.0, only_high_known=True)
    assert _smaller_density(Density(3.0, 2.9, 3.1), hidden) == Density(3.0, 0.0, 4.0)
    assert _smaller_density(Density(9.0, 8.9, 9.1), hidden) == Density(4.0, 0.0, 4.0)
    assert _smaller_density(None, hidden) == hidden


def test_of_two_estimates_of_noise_that_may_be_too_large_the_smaller_counts():
    loud, quiet = Density(3.0, 2.9, 3.1), Density(1.0, 0.8, 1.3)
    assert _smaller_density(loud, quiet) == _smaller_density(quiet, loud) == quiet
    assert _smaller_density(None, None) is None


def test_an_effect_of_twenty_floors_changes_the_floor_by_a_fifth_at_most(made):
    # Known truth: the same noise with and without friction that the model lacks.
    without, with_it = (floors(made(acting=size)[0]).value for size in (0.0, 0.3))
    assert np.all(np.maximum(with_it / without, without / with_it) < 1.2)


def test_noise_behind_a_lag_may_be_as_large_in_the_band_as_it_is(made):
    # Known truth: most noise has a corner at 1 Hz, within the band, and is more than its density above the band says.
    session, true = made(noise=0.05, lagging=2.0)
    found = floors(session)
    assert np.all((found.high < true) & (true < found.limit_if_rising))


def test_white_noise_does_not_rise(made):
    assert not floors(made()[0]).limit_if_rising.any()


def test_noise_rises_on_all_joints_if_it_does_on_most():
    rises, white = Density(1.0, 0.5, 2.0, rises=True, limit_if_rising=8.0), Density(1.0, 0.5, 2.0, limit_if_rising=4.0)
    assert joints_with_rising_noise([rises, None, white, rises]) == [True, False, True, True]
    assert joints_with_rising_noise([rises, None, white]) == [True, False, False]


def test_noise_rises_in_the_mean_if_it_does_in_one_recording():
    rises, white = Density(1.0, 0.5, 2.0, rises=True, limit_if_rising=8.0), Density(1.0, 0.5, 4.0, limit_if_rising=4.0)
    assert _mean_density([rises, white], [1.0, 1.0]) == Density(1.0, 0.5, 3.0, rises=True, limit_if_rising=6.0)
    assert _mean_density([white, None], [1.0, 1.0]) == white


def test_the_interval_holds_the_value(made):
    found = floors(made()[0])
    assert np.all((found.low < found.value) & (found.value < found.high))
    assert np.all(found.known)


def test_readings_that_leave_no_band_above_show_no_noise(made):
    session, _ = made()
    assert not floors(replace(session, cutoff_hz=0.3 * session.logs[0].band.rate_hz)).known.any()


def test_noise_that_is_drawn_from_the_sensors_is_as_large_as_the_true_one(made):
    # In the judged band, on usable samples.
    session, true = made(noise=0.05)
    columns = build_columns(session, FitPoint())
    unpredicted = tuple(np.full(part.shape, 1e3) for part in columns.residual)
    np.testing.assert_allclose(in_band(session, columns, unpredicted) / true, 1.0, atol=0.3)


def test_white_noise_is_at_most_what_models_do_not_predict_in_the_band(made):
    # Known truth: a third of the noise that is seen above the band, as where a controller answers its encoder there.
    session, true = made(noise=0.05)
    columns = build_columns(session, FitPoint())
    third = tuple(np.broadcast_to(true / 3.0, part.shape) for part in columns.residual)
    np.testing.assert_allclose(in_band(session, columns, third) / true, 1.0 / 3.0, atol=0.1)


def in_band(session, columns, unpredicted):
    """Root mean square of the noise of the sensors in the judged band, on usable samples."""
    (drawn,) = session.in_judged_band(sensed_noise(session, columns, unpredicted))
    use = columns.usable[0]
    return np.sqrt(np.sum(np.where(use, drawn, 0.0) ** 2, axis=0) / use.sum(axis=0))


def test_a_torque_that_stays_within_a_step_for_long_may_err_by_its_rounding(lab, planar2):
    # By hand: errors of rounding to steps of d that are equally likely have a root mean square of d / sqrt(12).
    recording = lab.recording(planar2, lab.motion(2, seconds=40.0, swing=0.2), noise=0.0)
    step = float(np.ptp(recording.tau[:, 1])) / 20.0
    assert floors(session_of(planar2, (recording,))).high[1] < step / np.sqrt(12.0)
    rounded = replace(recording, tau=np.round(recording.tau / step) * step)
    assert floors(session_of(planar2, (rounded,))).high[1] >= 0.99 * step / np.sqrt(12.0)
