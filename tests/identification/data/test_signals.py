"""From raw samples to logs. Oracle: closed forms of a mass on a slide and of its force, known truths."""

from dataclasses import replace

import numpy as np
import pytest

from identification.data.signals import (
    align_held_torque,
    differentiate,
    interpolated_noise,
    process,
    uniform,
    within_limits,
)
from phantom_dyn import load_robot
from phantom_dyn.errors import LogError
from phantom_dyn.model.robot import Actuator, Robot
from swung_slide import RATE, T, recording, swing


@pytest.fixture(scope="module")
def slide() -> Robot:
    """A mass of 95.1089 kg on a horizontal slide, without friction."""
    return load_robot("emps")


def held(tau: np.ndarray, mass: float) -> np.ndarray:
    """Closed form of a mass under a force that is held from sample to sample."""
    a = tau / mass
    v = np.concatenate([[0.0], np.cumsum(a[:-1]) / RATE])
    steps = v[:-1] / RATE + 0.5 * a[:-1] / RATE**2
    return np.concatenate([[0.0], np.cumsum(steps)])


@pytest.mark.parametrize("hz", [2.0, 6.0, 12.0])
def test_an_aligned_held_torque_is_what_the_mass_feels_at_the_samples(hz):
    # Closed form: a held sine acts half a sample late and weaker by sinc(f T).
    tau = np.sin(2 * np.pi * hz * T)
    felt = np.sinc(hz / RATE) * np.sin(2 * np.pi * hz * (T - 0.5 / RATE))
    np.testing.assert_allclose(align_held_torque(tau[:, None])[2:-1, 0], felt[2:-1], atol=1e-3)


def test_a_held_step_of_torque_is_spread_over_two_samples_before_and_after():
    # By hand: the weights -1, 13, 13, -1 over 24 of a torque of 24 held in one sample; the ends repeat.
    inside, first, last = np.zeros((3, 7, 1))
    inside[3], first[0], last[6] = 24.0, 24.0, 24.0
    np.testing.assert_allclose(align_held_torque(inside)[:, 0], [0, 0, -1, 13, 13, -1, 0])
    np.testing.assert_allclose(align_held_torque(first)[:, 0], [25, 12, -1, 0, 0, 0, 0], atol=1e-12)
    np.testing.assert_allclose(align_held_torque(last)[:, 0], [0, 0, 0, 0, 0, -1, 12], atol=1e-12)


def test_a_mass_driven_by_a_held_force_is_found_to_a_thousandth(slide):
    # Known truth: double integrator, exact integration between samples.
    tau = swing(T)[1]
    robot = replace(slide, torque_hold="zoh")
    log = process(recording(T, held(tau, 95.1089), tau), robot, cutoff_hz=12.0)
    a, force = log.band(log.motion.a[:, 0]), log.band(log.tau[:, 0])
    assert a @ force / (a @ a) == pytest.approx(95.1089, rel=1e-3)
    assert np.std(force - 95.1089 * a) < 1e-3 * np.std(force)


def test_a_held_force_taken_as_instant_leaves_half_a_sample(slide):
    # Closed form: the rest of a sine that is half a sample late is 2 sin(pi f T / 2) of it.
    tau = np.sin(2 * np.pi * 6.0 * T)
    log = process(recording(T, held(tau, 95.1089), tau), slide, cutoff_hz=12.0)
    rest = log.band(log.tau[:, 0] - 95.1089 * log.motion.a[:, 0])
    assert np.std(rest) == pytest.approx(2 * np.sin(np.pi * 6.0 / RATE / 2) / np.sqrt(2), rel=0.05)


@pytest.mark.parametrize("hz", [1.0, 7.0, 30.0])
def test_derivatives_of_a_sine_are_those_of_the_sine(hz):
    # Closed form; 30 Hz is near a sixth of the rate.
    w = 2 * np.pi * hz
    q, v, a = differentiate(np.sin(w * T)[:, None], RATE, 0.5 * RATE)
    inside = slice(20, -20)
    np.testing.assert_array_equal(q[:, 0], np.sin(w * T))
    np.testing.assert_allclose(v[inside, 0], w * np.cos(w * T)[inside], atol=0.005 * w)
    np.testing.assert_allclose(a[inside, 0], -(w**2) * np.sin(w * T)[inside], atol=0.005 * w**2)


def test_derivatives_have_no_delay_under_the_filter():
    # Two and a half times below the cut-off the filter takes a thousandth off, and shifts nothing.
    w = 2 * np.pi * 4.0
    q, v, a = differentiate(np.sin(w * T)[:, None], RATE, 10.0)
    inside = slice(200, -200)
    np.testing.assert_allclose(q[inside, 0], np.sin(w * T)[inside], atol=2e-3)
    np.testing.assert_allclose(v[inside, 0], w * np.cos(w * T)[inside], atol=2e-3 * w)
    np.testing.assert_allclose(a[inside, 0], -(w**2) * np.sin(w * T)[inside], atol=2e-3 * w**2)


def test_a_straight_motion_stays_straight_up_to_its_ends_under_the_filter():
    # Closed form: a low pass without delay leaves a line as it is; what is added before it is filtered continues it.
    q, v, _ = differentiate((1.0 + 2.0 * T)[:, None], RATE, 10.0)
    np.testing.assert_allclose(q[:, 0], 1.0 + 2.0 * T, atol=1e-4)
    np.testing.assert_allclose(v, 2.0, atol=0.01)


def test_above_two_fifths_of_the_rate_nothing_is_filtered(rng):
    q = rng.normal(size=(200, 1))
    np.testing.assert_array_equal(differentiate(q, RATE, 0.4 * RATE)[0], q)
    assert np.abs(differentiate(q, RATE, 0.39 * RATE)[0] - q).max() > 0.01


def test_a_motion_of_a_few_samples_is_filtered_too():
    # Closed form: twelve samples at rest stay where they are, although the filter reaches over sixty.
    np.testing.assert_allclose(differentiate(np.full((12, 1), 0.7), RATE, 10.0)[0], 0.7, rtol=1e-9)


def test_noise_above_the_cutoff_does_not_reach_the_acceleration(rng):
    # A hum of 1e-4 at 60 Hz would be an acceleration of 14.
    hum = 1e-4 * np.sin(2 * np.pi * 60.0 * T)
    a = differentiate(hum[:, None], RATE, 10.0)[2]
    assert np.abs(a[200:-200]).max() < 0.05


def test_a_uniform_recording_stays_as_it_is(slide):
    q, tau = swing(T)
    t, positions, torques, valid = uniform(recording(T, q, tau))
    np.testing.assert_array_equal(t, T)
    np.testing.assert_array_equal(positions[:, 0], q)
    np.testing.assert_array_equal(torques[:, 0], tau)
    assert valid.all()


def test_an_irregular_recording_is_brought_to_its_median_step(rng):
    times = T + 0.3 / RATE * rng.uniform(-1, 1, len(T))
    t, q, tau, valid = uniform(recording(times, *swing(times)))
    step = np.diff(t)
    assert step == pytest.approx(np.median(np.diff(times)))
    position, force = swing(t)
    np.testing.assert_allclose(q[:, 0], position, atol=1e-5)
    np.testing.assert_allclose(tau[:, 0], force, atol=0.01 * np.abs(force).max())
    assert valid.all()


def test_a_gap_is_invalid_and_nothing_else():
    keep = (T < 4.0) | (T > 4.4)
    q, tau = swing(T)
    t, _, _, valid = uniform(recording(T[keep], q[keep], tau[keep]))
    np.testing.assert_array_equal(valid, (t < T[T < 4.0][-1]) | (t > T[T > 4.4][0]))
    assert not valid.all()


def test_a_dropped_sample_is_no_gap():
    keep = np.arange(len(T)) != 700
    q, tau = swing(T)
    assert uniform(recording(T[keep], q[keep], tau[keep]))[3].all()


@pytest.mark.parametrize(("steps", "gap"), [(5, False), (6, True)])
def test_more_than_five_steps_without_a_sample_are_a_gap(steps, gap):
    # By hand: between samples 700 and 700 + steps; the sample before and the one behind are not used either.
    t = np.append(np.arange(701.0), np.arange(700.0 + steps, 2000.0))
    valid = uniform(recording(t, *swing(t)))[3]
    assert (~valid).sum() == (steps + 1 if gap else 0)


@pytest.mark.parametrize(("jitter", "resampled"), [(0.9e-3, False), (1.1e-3, True)])
def test_steps_that_differ_by_a_thousandth_are_brought_to_one_step(jitter, resampled):
    times = T.copy()
    times[500:] += jitter / RATE
    assert (uniform(recording(times, *swing(times)))[0] is not times) is resampled


@pytest.mark.parametrize("rate", [2.0, 256.0, 2.0**17])
def test_resampled_recordings_keep_their_first_and_last_sample(rate):
    # Steps of a power of two have no rounding: the last sample is a whole number of steps from the first.
    even = np.arange(2000) / rate
    times = even.copy()
    times[1] += 0.3 / rate
    np.testing.assert_array_equal(uniform(recording(times, *swing(times)))[0], even)


def test_a_torque_between_samples_lies_on_the_line_that_joins_them():
    times = T.copy()
    times[500] += 0.4 / RATE
    tau = np.zeros(len(T))
    tau[500] = 1.0
    assert uniform(recording(times, T, tau))[2][500, 0] == pytest.approx(1.0 / 1.4)


def test_half_way_between_samples_noise_is_a_mean_of_two_which_neighbours_share():
    # Closed form: (a + b) / 2 has half the variance, shares a quarter with the next one, and nothing beyond it.
    times = np.arange(100.0)
    np.testing.assert_allclose(interpolated_noise(times, times[:-1] + 0.5), (0.5, 0.25, 0.0), atol=1e-12)


def test_noise_of_even_samples_stays_white():
    assert interpolated_noise(T, T) == (1.0, 0.0, 0.0)


@pytest.mark.parametrize(("jump", "refused"), [(3990, False), (4005, True)])
def test_a_jump_that_makes_a_recording_three_times_as_long_is_refused(jump, refused):
    # By hand: 2000 samples span 1999 steps, with a jump of so many more; three times 2000 are too many.
    times = T + jump / RATE * (np.arange(len(T)) >= 700)
    q, tau = swing(T)
    if refused:
        with pytest.raises(LogError, match=r"swing\.csv: the time jumps from 3\.495 to 23\.525 s, a gap longer"):
            uniform(recording(times, q, tau))
    else:
        assert not uniform(recording(times, q, tau))[3].all()


@pytest.mark.parametrize(("milliseconds", "gap"), [(20, False), (30, True)])
def test_of_even_steps_five_are_the_longest_that_are_no_gap_in_any_band(slide, milliseconds, gap):
    keep = (T <= 4.0) | (4.0 + 1e-3 * milliseconds - 1e-9 <= T)
    q, tau = swing(T)
    valid = process(recording(T[keep], q[keep], tau[keep]), slide, cutoff_hz=2.0).valid
    assert bool(valid.all()) is not gap


def test_at_chance_times_a_gap_is_three_tenths_of_a_period_of_the_bands_edge(slide, rng):
    # By hand: of 10 Hz that is 30 ms; five medians are 17 ms, five of the step that a quarter are longer than 35 ms.
    times = np.sort(rng.uniform(T[0], T[-1], len(T)))
    log = process(recording(times, *swing(times)), slide, cutoff_hz=10.0)
    inside = np.zeros(len(log.motion.t), dtype=bool)
    for k in np.flatnonzero(np.diff(times) > 0.03):
        inside |= (log.motion.t >= times[k]) & (log.motion.t <= times[k + 1])
    np.testing.assert_array_equal(log.valid, ~inside)


def test_samples_at_chance_times_are_used_in_a_band_that_they_carry(slide, rng):
    # Known truth: of three steps in a hundred of a Poisson process each is longer than five medians.
    times = np.sort(rng.uniform(T[0], T[-1], len(T)))
    log = process(recording(times, *swing(times)), slide, cutoff_hz=3.0)
    a, force = log.band(log.motion.a[:, 0]), log.band(log.tau[:, 0])
    assert log.valid_in_band.mean() > 0.5
    assert a @ force / (a @ a) == pytest.approx(95.1089, rel=5e-3)


def test_an_excluded_stretch_is_invalid_and_nothing_else():
    valid = uniform(recording(T, *swing(T), excluded=((2.0, 3.0), (7.5, 20.0))))[3]
    np.testing.assert_array_equal(valid, (T < 2.0) | ((T > 3.0) & (T < 7.5)))


def test_in_the_band_only_kernels_that_touch_an_excluded_stretch_are_invalid(slide):
    log = process(recording(T, *swing(T), excluded=((2.0, 3.0),)), slide, cutoff_hz=10.0)
    reach = log.band.half / RATE
    at = log.motion.t[log.samples]
    np.testing.assert_array_equal(log.valid_in_band, (at < 2.0 - reach - 1e-9) | (at > 3.0 + reach + 1e-9))


def test_a_recording_that_is_too_short_is_refused(slide):
    few = T[:60]
    with pytest.raises(
        LogError, match=r"swing\.csv lasts 0\.29 s, too short for a band of 2 Hz, .* at least 10 s of motion, or at a"
    ):
        process(recording(few, *swing(few)), slide, cutoff_hz=2.0)


@pytest.mark.parametrize(("samples", "enough"), [(232, False), (233, True)])
def test_twenty_samples_in_the_band_are_enough(slide, samples, enough):
    # By hand: a kernel of half length 40 and every eighth sample: 40, 48, ..., 192 are twenty, 192 + 40 the last.
    few = T[:samples]
    if enough:
        assert len(process(recording(few, *swing(few)), slide, cutoff_hz=10.0).samples) == 20
    else:
        with pytest.raises(LogError, match="too short for a band"):
            process(recording(few, *swing(few)), slide, cutoff_hz=10.0)


@pytest.mark.parametrize("field", ["q_ref", "temperature"])
def test_references_and_temperatures_are_brought_to_the_same_instants(slide, field):
    # Closed form: a ramp lies on itself wherever it is asked for.
    times = T.copy()
    times[1:-1] += 0.3 / RATE * np.sin(np.arange(len(T) - 2))
    log = process(
        replace(recording(times, *swing(times)), **{field: (30.0 + 2.0 * times)[:, None]}), slide, cutoff_hz=10.0
    )
    np.testing.assert_allclose(getattr(log, field)[:, 0], 30.0 + 2.0 * log.motion.t, atol=1e-12)
    even = replace(recording(T, *swing(T)), **{field: (2.0 * T)[:, None]})
    assert getattr(process(even, slide, cutoff_hz=10.0), field) is getattr(even, field)
    assert getattr(process(recording(T, *swing(T)), slide, cutoff_hz=10.0), field) is None


def test_a_recording_without_torque_is_refused(slide):
    q, tau = swing(T)
    with pytest.raises(LogError, match=r"swing\.csv has no torque, current or voltage: record one, or see --motion-"):
        process(replace(recording(T, q, tau), tau=None), slide)


ASKED = np.array([[-9.0, -9.0, -9.0], [-4.0, -4.0, -4.0], [0.0, 0.0, 0.0], [4.0, 4.0, 4.0], [9.0, 9.0, 9.0]])


@pytest.fixture
def limited(arm) -> Robot:
    """Drives that give 5 and 3 N m at most, and one without a stated limit."""
    return replace(arm, actuators=tuple(Actuator(torque_limit=limit) for limit in (5.0, 3.0, None)))


def test_a_drive_gives_no_more_of_a_commanded_torque_than_its_limit_in_both_directions(limited):
    # Closed form: the sign of what is asked for, times the smaller of its size and the limit.
    given = within_limits(ASKED, replace(limited, torque_source="command"))
    np.testing.assert_array_equal(given, np.sign(ASKED) * np.minimum(np.abs(ASKED), [5.0, 3.0, np.inf]))


def test_a_measured_torque_stays_as_it_is_above_the_limits(limited):
    np.testing.assert_array_equal(within_limits(ASKED, replace(limited, torque_source="sensor")), ASKED)
