from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from identification.data.recording import Recording
from identification.data.signals import (
    _moving_edge,
    _within_rate,
    acceleration_edge,
    align_held_torque,
    choose_cutoff,
    differentiate,
    low_pass,
    motion_edge,
    process,
    process_all,
    smoothed,
    uniform,
    within_limits,
)
from phantom_dyn import load_robot
from phantom_dyn.errors import LogError
from phantom_dyn.model.robot import Actuator, Robot

RATE = 200.0
T = np.arange(2000) / RATE


@pytest.fixture(scope="module")
def slide() -> Robot:
    """A mass of 95.1089 kg on a horizontal slide, without friction."""
    return load_robot("emps")


def recording(t: np.ndarray, q: np.ndarray, tau: np.ndarray, **more) -> Recording:
    return Recording("swing.csv", ("axis",), t, q[:, None], tau[:, None], **more)


def swing(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions of the slide and the force that they need."""
    w, amplitude, phase = 2 * np.pi * np.array([0.5, 1.3, 2.9]), np.array([0.1, 0.05, 0.01]), np.array([0.3, 1.0, 2.2])
    waves = amplitude * np.sin(np.outer(t, w) + phase)
    return waves.sum(axis=1), -95.1089 * waves @ w**2


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


def test_a_constant_torque_is_aligned_with_itself():
    np.testing.assert_allclose(align_held_torque(np.full((9, 2), 3.0)), 3.0)


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


@pytest.mark.parametrize(
    ("cutoff_hz", "half", "step"), [(10.0, 40, 8), (9.0, 45, 8), (12.0, 34, 6), (79.0, 6, 1), (3.0, 134, 26)]
)
def test_a_band_reaches_over_two_periods_of_its_edge_and_keeps_two_and_a_half_samples_of_one(cutoff_hz, half, step):
    # By hand: 400 over the edge, rounded up, and 80 over it, rounded down.
    band = low_pass(cutoff_hz, RATE)
    assert (band.rate_hz, band.cutoff_hz, band.half, band.step) == (RATE, cutoff_hz, half, step)


def test_the_edge_of_a_band_is_where_half_of_the_amplitude_is_left():
    # Closed form: the answer of a symmetric kernel to a cosine.
    band = low_pass(10.0, RATE)
    lags = np.arange(-band.half, band.half + 1) / RATE
    gains = [band.kernel @ np.cos(2 * np.pi * f * lags) for f in (0.0, 10.0, 20.0)]
    assert gains == pytest.approx([1.0, 0.5, 0.0], abs=5e-3)


def test_a_band_up_to_two_fifths_of_the_rate_lets_everything_through():
    band = low_pass(0.4 * RATE, RATE)
    assert (band.cutoff_hz, band.step) == (0.5 * RATE, 1)
    np.testing.assert_array_equal(band.kernel, [1.0])


@pytest.mark.parametrize(("cutoff_hz", "kept_hz"), [(10.0, 25.0), (30.0, 75.0), (35.0, 80.0)])
def test_positions_are_kept_to_two_and_a_half_times_the_band_or_two_fifths_of_the_rate(cutoff_hz, kept_hz):
    assert motion_edge(low_pass(cutoff_hz, RATE)) == pytest.approx(kept_hz)


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


def test_an_irregular_recording_gives_the_same_mass(slide, rng):
    times = T + 0.3 / RATE * rng.uniform(-1, 1, len(T))
    log = process(recording(times, *swing(times)), slide, cutoff_hz=10.0)
    a, force = log.band(log.motion.a[:, 0]), log.band(log.tau[:, 0])
    assert a @ force / (a @ a) == pytest.approx(95.1089, rel=5e-3)


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


def test_resampled_recordings_keep_their_first_and_last_sample():
    # A step of 1/256 s has no rounding: the last sample is a whole number of steps from the first.
    even = np.arange(2000) / 256.0
    times = even.copy()
    times[1] += 0.3 / 256.0
    np.testing.assert_array_equal(uniform(recording(times, *swing(times)))[0], even)


def test_a_torque_between_samples_lies_on_the_line_that_joins_them():
    times = T.copy()
    times[500] += 0.4 / RATE
    tau = np.zeros(len(T))
    tau[500] = 1.0
    assert uniform(recording(times, T, tau))[2][500, 0] == pytest.approx(1.0 / 1.4)


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
        LogError, match=r"swing\.csv lasts 0\.29 s, too short for a band of 2\.0 Hz: record at least ten seconds"
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


def test_references_are_brought_to_the_same_instants(slide):
    # Closed form: a ramp lies on itself wherever it is asked for.
    times = T.copy()
    times[1:-1] += 0.3 / RATE * np.sin(np.arange(len(T) - 2))
    asked = replace(recording(times, *swing(times)), q_ref=(2.0 * times)[:, None])
    log = process(asked, slide, cutoff_hz=10.0)
    np.testing.assert_allclose(log.q_ref[:, 0], 2.0 * log.motion.t, atol=1e-12)
    even = replace(recording(T, *swing(T)), q_ref=(2.0 * T)[:, None])
    assert process(even, slide, cutoff_hz=10.0).q_ref is even.q_ref


def test_without_an_edge_the_data_choose_the_band(slide, rng):
    q, tau = swing(T)
    noisy = recording(T, q + 1e-6 * rng.normal(size=len(T)), tau + rng.normal(size=len(T)))
    rate = (len(T) - 1) / (T[-1] - T[0])
    chosen = choose_cutoff([(noisy.q, noisy.tau, rate)])
    assert process(noisy, slide).band.cutoff_hz == chosen


def test_a_recording_without_torque_is_refused(slide):
    q, tau = swing(T)
    with pytest.raises(LogError, match=r"swing\.csv has no torque, current or voltage: record one, or see --motion-"):
        process(replace(recording(T, q, tau), tau=None), slide)


def test_smoothing_leaves_what_is_below_and_takes_what_is_above():
    low, high = np.sin(2 * np.pi * 2.0 * T), np.sin(2 * np.pi * 40.0 * T)
    out = smoothed(np.column_stack([low, low + high]), RATE, 10.0)
    assert out.shape == (len(T), 2)
    np.testing.assert_allclose(out[100:-100, 0], low[100:-100], atol=5e-3)
    np.testing.assert_allclose(out[100:-100, 1], out[100:-100, 0], atol=5e-3)


def test_smoothing_sees_its_mirror_image_beyond_the_ends():
    # Closed form: cosines of whole half periods go on as they are in a mirror, so that they are only scaled.
    wave = np.cos(np.pi * np.arange(401) / 20.0)  # 5 Hz
    gain = smoothed(wave, RATE, 10.0)[200] / wave[200]
    assert gain == pytest.approx(1.0, abs=0.01)
    np.testing.assert_allclose(smoothed(wave, RATE, 10.0), gain * wave, atol=1e-12)


def test_what_is_shorter_than_the_kernel_is_smoothed_by_its_middle(rng):
    # Closed form: over nine samples, the middle one sees all eight others once on either side.
    x = rng.normal(size=9)
    kernel = low_pass(10.0, RATE).kernel[32:49]
    around = np.concatenate([x[4:0:-1], x, x[7:3:-1]])
    assert smoothed(x, RATE, 10.0)[4] == pytest.approx(kernel @ around / kernel.sum())


def test_one_sample_stays_as_it_is():
    np.testing.assert_array_equal(smoothed(np.array([3.0]), RATE, 10.0), [3.0])


def test_smoothing_leaves_a_constant_up_to_its_ends():
    np.testing.assert_allclose(smoothed(np.full(300, 2.5), RATE, 10.0), 2.5, rtol=1e-12)


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


def test_the_band_of_emps_lies_where_the_published_friction_comes_back(slide, data_folder: Path):
    # Published values need more than 20 Hz, which loses 3 % of the viscous coefficient, and less than the noise at 80.
    data = np.load(data_folder / "emps" / "emps_train.npz")
    rate = (len(data["t"]) - 1) / (data["t"][-1] - data["t"][0])
    assert 40.0 < choose_cutoff([(data["q_meas"][:, None], data["force"][:, None], rate)]) < 70.0


def test_a_coarser_encoder_narrows_the_band(rng):
    f = np.arange(0.2, 25.0, 0.2)
    q = (np.cos(2 * np.pi * np.outer(T, f) + rng.uniform(0, 6.3, len(f))) / f**4).sum(axis=1)
    tau = rng.normal(size=len(T))
    edges = [choose_cutoff([(np.round(q / step)[:, None] * step, tau[:, None], RATE)]) for step in (1e-4, 1e-3, 1e-2)]
    assert edges[0] > 1.2 * edges[1] > 1.2**2 * edges[2]


def test_the_band_ends_where_the_recorder_has_smoothed_the_torque(rng):
    # Known truth: a kernel whose stop band begins at 3 Hz; a bin of the spectrum is 0.5 Hz wide.
    q = swing(T)[0] + 1e-9 * rng.normal(size=len(T))
    rough = rng.normal(size=len(T))
    narrow = choose_cutoff([(q[:, None], smoothed(rough, RATE, 2.0)[:, None], RATE)])
    assert 2.0 < narrow <= 4.0
    assert choose_cutoff([(q[:, None], rough[:, None], RATE)]) > 1.2 * narrow


def test_several_recordings_share_one_band_that_holds_the_judged_one(slide, rng):
    q, tau = swing(T)
    noisy = recording(T, q + 1e-5 * rng.normal(size=len(T)), tau + rng.normal(size=len(T)))
    half = replace(noisy, t=noisy.t[:900], q=noisy.q[:900], tau=noisy.tau[:900])
    logs, judged = process_all((noisy, half), slide)
    assert logs[0].band.cutoff_hz == logs[1].band.cutoff_hz
    assert judged <= logs[0].band.cutoff_hz <= 4 * judged
    assert [len(log.motion.t) for log in logs] == [2000, 900]


@pytest.mark.parametrize(("edge", "inside"), [(0.3, 1.0), (5.0, 5.0), (30.0, 6.0), (np.inf, 6.0)])
def test_an_edge_lies_between_one_hertz_and_six_per_cent_of_the_lowest_rate(edge, inside):
    still = np.zeros((10, 1))
    assert _within_rate(edge, [(still, still, 200.0), (still, still, 100.0)]) == pytest.approx(inside)


def test_motion_ends_at_the_median_over_joints_that_move(rng):
    f = np.arange(0.2, 60.0, 0.2)
    phase = rng.uniform(0, 6.3, (4, len(f)))
    tops = (4.0, 8.0, 30.0)
    angle = 2 * np.pi * np.outer(T, f)
    moving = [(np.cos(angle + p) * (f < top) / f**2).sum(axis=1) for p, top in zip(phase[:3], tops, strict=True)]
    noise = 1e-4 * rng.normal(size=(4, len(T)))
    q = np.column_stack([*moving, np.zeros(len(T))]) + noise.T
    edges = [acceleration_edge(column, RATE) for column in q.T]
    assert edges[3] is None
    assert edges[0] < edges[1] < edges[2]
    assert _moving_edge([(part, part, RATE) for part in (q[:, :2], q[:, 2:])]) == edges[1]


def test_where_no_joint_moves_motion_ends_nowhere(rng):
    assert _moving_edge([(np.zeros((len(T), 1)), np.zeros((len(T), 1)), RATE)]) == np.inf


def test_what_controllers_ask_for_is_no_limit_to_the_band(slide, rng):
    # Known truth: the commands end at 2 Hz; a torque that was measured would end there because of its recorder.
    q = swing(T)[0] + 1e-9 * rng.normal(size=len(T))
    asked = recording(T, q, smoothed(rng.normal(size=len(T)), RATE, 2.0))
    judged = {kind: process_all((replace(asked, controlled=kind),), slide)[1] for kind in (True, False)}
    assert _moving_edge([(asked.q, asked.tau, RATE)]) > 12.0
    assert judged[True] == pytest.approx(12.0)  # six per cent of the rate
    assert judged[False] < judged[True]


def test_logs_reach_three_tenths_above_what_the_drives_move(slide, rng):
    # Known truth: hums in all thirds of the octave below 12 Hz, six per cent of the rate, that no drive makes.
    q, tau = swing(T)
    hum = 1e-3 * np.sin(2 * np.pi * np.outer([6.8, 8.5, 10.5], T)).sum(axis=0)
    (log,), judged = process_all((recording(T, q + hum, tau + 5.0 * rng.normal(size=len(T))),), slide)
    assert log.band.cutoff_hz == pytest.approx(1.3 * 6.0)
    assert judged <= 6.0 + 1e-9
