"""The band of recordings and smoothing in it. Oracle: closed forms of kernels and waves, known truths."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from identification.data.derivatives import motion_edge
from identification.data.log import Band
from identification.data.signals import (
    _moving_edge,
    _within_rate,
    acceleration_edge,
    choose_cutoff,
    low_pass,
    narrowed,
    process,
    process_all,
    smoothed,
)
from phantom_dyn import load_robot
from phantom_dyn.model.robot import Robot
from swung_slide import RATE, T, recording, swing


@pytest.fixture(scope="module")
def slide() -> Robot:
    """A mass of 95.1089 kg on a horizontal slide, without friction."""
    return load_robot("emps")


@pytest.mark.parametrize(
    ("cutoff_hz", "half", "step"), [(10.0, 40, 8), (9.0, 45, 8), (12.0, 34, 6), (79.0, 6, 1), (3.0, 134, 26)]
)
def test_a_band_reaches_over_two_periods_of_its_edge_and_keeps_two_and_a_half_samples_of_one(cutoff_hz, half, step):
    # By hand: 400 over the edge, rounded up, and 80 over it, rounded down.
    band = low_pass(cutoff_hz, RATE)
    assert (band.rate_hz, band.cutoff_hz, band.half, band.step) == (RATE, cutoff_hz, half, step)


def test_a_band_up_to_two_fifths_of_the_rate_lets_everything_through():
    band = low_pass(0.4 * RATE, RATE)
    assert (band.cutoff_hz, band.step) == (0.5 * RATE, 1)
    np.testing.assert_array_equal(band.kernel, [1.0])


@pytest.mark.parametrize(("cutoff_hz", "kept_hz"), [(10.0, 25.0), (30.0, 75.0), (35.0, 80.0)])
def test_positions_are_kept_to_two_and_a_half_times_the_band_or_two_fifths_of_the_rate(cutoff_hz, kept_hz):
    assert motion_edge(low_pass(cutoff_hz, RATE)) == pytest.approx(kept_hz)


def test_without_an_edge_the_data_choose_the_band(slide, rng):
    q, tau = swing(T)
    noisy = recording(T, q + 1e-6 * rng.normal(size=len(T)), tau + rng.normal(size=len(T)))
    rate = (len(T) - 1) / (T[-1] - T[0])
    chosen = choose_cutoff([(noisy.q, noisy.tau, rate)])
    assert process(noisy, slide).band.cutoff_hz == chosen


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


def test_each_stretch_between_holes_is_smoothed_as_if_it_were_a_recording_of_its_own(rng):
    x, valid = rng.normal(size=(401, 2)), np.ones(401, dtype=bool)
    valid[150:160] = valid[300] = False
    x[~valid] = 1e6  # made up, and carried nowhere
    out = narrowed(x, valid, Band(RATE, 30.0, np.ones(1), 1), 10.0)
    for part in (slice(0, 150), slice(160, 300), slice(301, 401)):
        np.testing.assert_array_equal(out[part], smoothed(x[part], RATE, 10.0))
    assert not out[~valid].any()


def test_one_sample_stays_as_it_is():
    np.testing.assert_array_equal(smoothed(np.array([3.0]), RATE, 10.0), [3.0])


def test_smoothing_leaves_a_constant_up_to_its_ends():
    np.testing.assert_allclose(smoothed(np.full(300, 2.5), RATE, 10.0), 2.5, rtol=1e-12)


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


@pytest.mark.parametrize(("seconds", "driven"), [(40.0, 6.0), (10.0, 12.0)])
def test_logs_reach_three_tenths_above_what_the_drives_move_where_that_leaves_enough_samples(
    slide, rng, seconds, driven
):
    # Known truth: hums in all thirds of the octave below 12 Hz, six per cent of the rate, that no drive makes. In 10 s
    # the 300 samples that are enough, 2.5 of a period, need a band of 12 Hz.
    t = np.arange(round(seconds * RATE)) / RATE
    q, tau = swing(t)
    hum = 1e-3 * np.sin(2 * np.pi * np.outer([6.8, 8.5, 10.5], t)).sum(axis=0)
    (log,), judged = process_all((recording(t, q + hum, tau + 5.0 * rng.normal(size=len(t))),), slide)
    assert log.band.cutoff_hz == pytest.approx(min(1.3 * driven, 12.0))
    assert judged <= driven + 1e-9
