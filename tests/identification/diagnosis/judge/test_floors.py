"""Noise floors and their intervals. Oracle: closed forms on noise of one size, NumPy's percentiles.

Floors by sensors in place of those by predictors. Oracle: the floor of the sensors alone, by hand.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import norm

from identification.diagnosis.fit.gap import judged_blocks, measured_torque, residual_sums
from identification.diagnosis.judge.floors import (
    NONE,
    REPETITIONS,
    SENSORS,
    Floor,
    _aliased_torque,
    floor_by_predictors,
    floor_by_sensors,
    judged_weights,
    reading_noise,
    sensor_floors,
    torque_above_band,
    uncertain_squares,
)
from identification.diagnosis.noise.repetitions import RepetitionNoise
from identification.diagnosis.noise.sensor_floor import SensorFloor
from identification.diagnosis.noise.sensor_noise import Density
from identification.engine.resampling import block_counts
from phantom_dyn.random_streams import random_stream

FLOOR = Floor(np.array([0.1, 0.2]), np.array([0.08, 0.16]), np.array([0.12, 0.24]), ("above_band", "predictors"))


def test_the_floor_of_a_fine_encoder_is_that_of_what_rounding_leaves():
    # Closed form: squares of independent noises add.
    fine = FLOOR.without(np.array([0.0, 0.03]))
    np.testing.assert_allclose(fine.value, [0.1, 0.1])
    np.testing.assert_allclose(fine.high / fine.value, FLOOR.high / FLOOR.value)


def test_the_floor_of_a_fine_encoder_is_three_tenths_of_the_noise_at_least():
    np.testing.assert_allclose(FLOOR.without(np.array([0.0099, 5.0])).value, [0.03, 0.06])


def test_without_a_coarse_reading_the_floor_stays():
    assert FLOOR.without(np.zeros(2)) is FLOOR


TORQUE = np.array([3.0, 50.0])


@pytest.fixture
def steady(quiet):
    """A recording judged as a whole, with noise of 0.1 and 0.2 in every sample and torques of 3 and 50 N m.

    Nothing but what `seen` says lies above its band.
    """
    every = np.ones_like(quiet.columns.residual[0])
    columns = replace(quiet.columns, model_torque=(0.25 * TORQUE * every,), residual=(0.75 * TORQUE * every,))
    logs = tuple(replace(log, tau=np.zeros_like(log.tau)) for log in quiet.session.logs)
    problem = replace(quiet.problem, session=replace(quiet.session, logs=logs, cutoff_hz=100.0), columns=columns)
    return problem, (np.array([0.1, 0.2]) * every,)


def like(steady, *sizes: float) -> tuple[np.ndarray, ...]:
    """A residual of so much in every sample."""
    return tuple(np.array(sizes) * np.ones_like(part) for part in steady[1])


def judged(problem) -> np.ndarray:
    """Usable samples of the first joint in the cores of the blocks that are judged."""
    cores = np.zeros(len(problem.columns.usable[0]), dtype=bool)
    for k in judged_blocks(problem):
        cores[problem.blocks[k].core : problem.blocks[k].stop] = True
    return cores & problem.columns.usable[0][:, 0]


def sure(steady) -> tuple[np.ndarray, ...]:
    """No doubt about friction at any time."""
    return like(steady, 0.0, 0.0)


def seen(monkeypatch, *densities: tuple[float, float, float] | None) -> None:
    """Torque sensors show densities that leave these figures in a band of 100 Hz: lowest, mean and highest."""

    def shown(logs, row, *, held):
        sizes = densities[row]
        if sizes is None:
            return None
        low, value, high = (size**2 / 100.0 for size in sizes)
        return Density(value, low, high)

    monkeypatch.setattr("identification.diagnosis.judge.floors.torque_noise", shown)


def test_without_sensors_to_see_the_floor_is_an_upper_limit_that_no_derivative_gets_below(steady, monkeypatch):
    # By hand: a thousandth of the torque beside the noise.
    seen(monkeypatch, None, None)
    floor = floor_by_predictors(*steady, like(steady, 9.0, 9.0), sure(steady))
    assert floor.source == ("predictors", "predictors")
    np.testing.assert_allclose(floor.value, [0.1, 0.2])
    np.testing.assert_allclose(floor.low, [0.1, 0.2])
    np.testing.assert_allclose(floor.high, np.hypot([0.1, 0.2], 0.001 * TORQUE))


@pytest.mark.parametrize(
    ("sizes", "source", "low"),
    [
        ((0.08, 0.09, 0.11), "above_band", 0.08),
        ((0.0999999, 0.1, 0.1000001), "above_band", 0.0999999),
        ((0.07, 0.08, 0.09), "predictors", 0.07),
        ((0.11, 0.12, 0.13), "predictors", 0.1),
    ],
)
def test_sensors_that_show_as_much_confirm_the_floor_and_others_lower_its_end(steady, monkeypatch, sizes, source, low):
    seen(monkeypatch, sizes, (0.19, 0.2, 0.21))
    floor = floor_by_predictors(*steady, like(steady, 9.0, 9.0), sure(steady))
    assert floor.source == (source, "above_band")
    assert (floor.value[0], floor.low[0]) == pytest.approx((0.1, low))
    assert floor.high[0] == pytest.approx(np.hypot(0.1, 0.003))
    assert floor.low[1] == pytest.approx(0.19)


# By hand: twice what the sensors show at most, 2.65 % of 3 N m beside it.
EDGE = 2.0 * np.hypot(0.01, np.sqrt(0.0007) * 3.0)


@pytest.mark.parametrize(
    ("noise", "left", "taken"),
    [(1.01 * EDGE, 9.0, True), (0.99 * EDGE, 9.0, False), (9.0, 1.01 * EDGE, True), (9.0, 0.99 * EDGE, False)],
)
def test_sensors_that_show_several_times_less_are_the_floor(steady, monkeypatch, noise, left, taken):
    problem, (series,) = steady
    seen(monkeypatch, (0.004, 0.007, 0.01), (0.19, 0.2, 0.21))
    floor = floor_by_predictors(problem, (series * [10.0 * noise, 1.0],), like(steady, left, 9.0), sure(steady))
    assert floor.value[0] == pytest.approx(0.007 if taken else noise)
    assert floor.low[0] == pytest.approx(0.004)
    assert floor.high[0] == pytest.approx(np.hypot(0.01 if taken else noise, 0.003))
    assert floor.source[0] == ("above_band" if taken else "predictors")


@pytest.mark.parametrize(("loud", "taken"), [(0.9, False), (1.6, True)])
def test_what_comes_and_goes_is_no_noise_where_it_is_several_times_louder(steady, monkeypatch, loud, taken):
    # By hand: normal noise with that median has 0.1 / 0.6745, and the method is accurate to 2.65 % of 3 N m.
    problem, (series,) = steady
    seen(monkeypatch, None, None)
    rare = np.where(np.arange(len(series)) % 40 < 4, loud, 0.1)
    usual = np.hypot(0.1 / norm.ppf(0.75), np.sqrt(0.0007) * 3.0)
    floor = floor_by_predictors(problem, (np.column_stack([rare, series[:, 1]]),), like(steady, 9.0, 9.0), sure(steady))
    assert floor.value[0] == pytest.approx(usual if taken else np.sqrt(np.mean(rare[judged(problem)] ** 2)), rel=1e-6)
    assert floor.low[0] <= floor.value[0] <= floor.high[0]
    assert floor.source[0] == "predictors"
    assert floor.value[1] == pytest.approx(0.2)


def answering(problem, size: float, hold: str = "instant"):
    """The problem with a tone far above the band on the first joint, ten times as large where it is not used."""
    (log,), (use,) = problem.session.logs, problem.columns.usable
    everywhere = np.interp(np.arange(len(log.tau)), log.samples, use[:, 0]) > 0.5
    tone = np.sqrt(2.0) * size * np.cos(0.9 * np.pi * np.arange(len(log.tau)))
    tau = np.column_stack([np.where(everywhere, tone, 10.0 * tone), np.zeros_like(tone)])
    robot = replace(problem.session.robot, torque_hold=hold)
    return replace(problem, session=replace(problem.session, robot=robot, logs=(replace(log, tau=tau),)))


def test_what_lies_above_the_band_in_motion_comes_down_as_its_share_of_the_frequencies(steady, monkeypatch):
    # Closed form: power spread evenly from the filter's edge to half the rate.
    problem, _ = steady
    use = np.arange(len(problem.columns.usable[0])) % 200 < 100
    problem = replace(problem, columns=replace(problem.columns, usable=(np.column_stack([use, use]),)))
    band = problem.session.logs[0].band
    share = problem.session.cutoff_hz / (0.5 * band.rate_hz - band.cutoff_hz)
    seen(monkeypatch, None, None)
    problem = answering(problem, 0.3)
    folded = _aliased_torque(problem, reading_noise(problem.session))
    np.testing.assert_allclose(folded, [0.3 * np.sqrt(share), 0.0], rtol=0.1, atol=1e-12)


def test_noise_of_the_sensors_is_no_answer_of_a_controller(steady, monkeypatch):
    # Closed form: white noise of 0.2 has a density of 0.04 over all frequencies; a tone of 0.3 stands beside it.
    problem, _ = steady
    band = problem.session.logs[0].band
    width, density = 0.5 * band.rate_hz - band.cutoff_hz, 0.04 / (0.5 * band.rate_hz)
    monkeypatch.setattr(
        "identification.diagnosis.judge.floors.torque_noise", lambda *_, held: Density(density, density, density)
    )
    problem = answering(problem, 0.3)
    squares = torque_above_band(problem, reading_noise(problem.session))
    np.testing.assert_allclose(squares, [0.09 - density * width, 0.0], rtol=0.1)


@pytest.mark.parametrize(("hold", "taken"), [("instant", False), ("zoh", True)])
def test_what_may_come_down_from_above_the_band_is_no_gap(steady, monkeypatch, hold, taken):
    # Known truth: sensors of 0.007, a noise of 1 in the band, and a controller that makes as much above it.
    problem, (series,) = steady
    seen(monkeypatch, (0.004, 0.007, 0.01), (0.19, 0.2, 0.21))
    floor = floor_by_predictors(
        answering(problem, 1.0, hold), (series * [10.0, 1.0],), like(steady, 1.0, 9.0), sure(steady)
    )
    assert floor.value[0] == pytest.approx(0.007 if taken else 1.0)


@pytest.mark.parametrize(("hold", "taken"), [("instant", False), ("zoh", True)])
def test_a_controller_that_answers_now_and_then_is_no_gap(steady, monkeypatch, hold, taken):
    problem, (series,) = steady
    seen(monkeypatch, None, None)
    rare = np.where(np.arange(len(series)) % 40 < 4, 1.6, 0.1)
    noise = (np.column_stack([rare, series[:, 1]]),)
    floor = floor_by_predictors(answering(problem, 1.0, hold), noise, like(steady, 9.0, 9.0), sure(steady))
    usual = np.hypot(0.1 / norm.ppf(0.75), np.sqrt(0.0007) * 3.0)
    assert floor.value[0] == pytest.approx(usual if taken else np.sqrt(np.mean(rare[judged(problem)] ** 2)), rel=1e-6)


@pytest.mark.parametrize(("white", "believed"), [(1, False), (2, False), (3, True), (6, True)])
def test_white_noise_is_believed_where_at_least_half_of_the_joints_show_it(monkeypatch, white, believed):
    # Known truth: a recorder smooths all joints alike, so that one of six is white by accident.
    shown = [Density(1.0, 1.0, 1.0) if j < white else None for j in range(6)]
    monkeypatch.setattr("identification.diagnosis.judge.floors.torque_noise", lambda _, j, held: shown[j])
    session = SimpleNamespace(robot=SimpleNamespace(nv=6, torque_hold="instant"), logs=())
    assert reading_noise(session) == (shown if believed else [None] * 6)


def test_noise_of_the_encoders_adds_to_what_the_sensors_show(steady, monkeypatch):
    # Closed form: squares of 3, 4, 5 of each joint's own.
    problem, (series,) = steady
    seen(monkeypatch, (0.003, 0.003, 0.003), (0.03, 0.03, 0.03))
    loud = (series * [100.0, 500.0],)
    floor = floor_by_predictors(problem, loud, like(steady, 9.0, 90.0), sure(steady), np.array([0.004, 0.04]))
    np.testing.assert_allclose(floor.value, [0.005, 0.05])
    np.testing.assert_allclose(floor.low, [0.005, 0.05])


def test_the_interval_of_a_floor_is_that_of_a_bootstrap_over_blocks_for_all_joints_together(steady, monkeypatch, rng):
    # NumPy's percentiles of the root mean square over drawn blocks, 5 % over two joints.
    problem, (series,) = steady
    seen(monkeypatch, None, None)
    noise = series * rng.normal(size=series.shape)
    floor = floor_by_predictors(problem, (noise,), like(steady, 9.0, 9.0), sure(steady))
    by_block = residual_sums(problem, (noise,))
    drawn = block_counts(len(by_block.counts), random_stream("bootstrap of the noise floor"))
    size = np.sqrt(drawn @ by_block.squares / (drawn @ by_block.counts))
    low, high = (np.percentile(size, side, axis=0) / by_block.rms() * floor.value for side in (1.25, 98.75))
    np.testing.assert_allclose(floor.value, np.sqrt(np.mean(noise[judged(problem)] ** 2, axis=0)))
    np.testing.assert_allclose(floor.low, low)
    np.testing.assert_allclose(floor.high, np.hypot(high, 0.001 * TORQUE))


@pytest.mark.parametrize(
    ("repeated", "left", "value", "source"),
    [
        (0.09, 0.1, 0.1, "repetitions"),
        (0.02, 0.1, 0.02, "repetitions"),
        (0.02, 0.07, 0.1, "repetitions"),
        (0.2, 0.1, 0.1, "predictors"),
    ],
)
def test_what_does_not_repeat_is_the_floor_where_it_is_less_than_all_else(
    steady, monkeypatch, repeated, left, value, source
):
    # By hand: it counts from 2.65 % of 3 N m on, 0.079 N m; what drifts does not repeat and is foreseen.
    seen(monkeypatch, None, None)
    shown = (RepetitionNoise(repeated, 0.01), None)
    monkeypatch.setattr("identification.diagnosis.judge.floors.repetition_noise", lambda *_: shown)
    floor = floor_by_predictors(*steady, like(steady, left, 9.0), sure(steady))
    assert floor.source == (source, "predictors")
    assert floor.value[0] == pytest.approx(value)


def test_the_interval_of_what_does_not_repeat_is_that_of_its_error(steady, monkeypatch):
    # Closed form: a log-normal estimate, 5 % over two joints.
    seen(monkeypatch, None, None)
    monkeypatch.setattr(
        "identification.diagnosis.judge.floors.repetition_noise", lambda *_: (RepetitionNoise(0.02, 0.1), None)
    )
    floor = floor_by_predictors(*steady, like(steady, 9.0, 9.0), sure(steady))
    assert floor.low[0] == pytest.approx(0.02 * np.exp(-0.1 * norm.ppf(0.9875)))
    assert floor.high[0] == pytest.approx(np.hypot(0.02 * np.exp(0.1 * norm.ppf(0.9875)), 0.003))


@pytest.mark.parametrize(
    ("left", "elsewhere", "deviation", "more"),
    [(0.5, 0.1, 1.0, 0.5), (0.5, 0.1, 0.2, 0.4), (9.0, 0.1, 0.05, 0.0), (0.5, 0.3, 1.0, 0.0)],
)
def test_the_interval_holds_what_is_left_where_friction_is_in_doubt(steady, left, elsewhere, deviation, more):
    # By hand, of the first joint in a quarter of the time: all that is left, two deviations at most; nothing where
    # friction is known better than the floor of 0.1, nor where three floors are left elsewhere too.
    problem, noise = steady
    open_, residual = np.zeros_like(noise[0]), np.array([elsewhere, 0.1]) * np.ones_like(noise[0])
    open_[: len(open_) // 4, 0] = deviation**2
    residual[: len(open_) // 4, 0] = left
    known, wider = (floor_by_predictors(problem, noise, (residual,), doubt) for doubt in (sure(steady), (open_,)))
    share = problem.columns.usable[0][: len(open_) // 4, 0].sum() / problem.columns.usable[0][:, 0].sum()
    assert wider.high[0] ** 2 - known.high[0] ** 2 == pytest.approx(share * more**2)
    assert (wider.high[1], wider.value[0]) == (known.high[1], known.value[0])


def test_a_floor_hardly_counts_what_nothing_foresees_of_a_standing_joint(steady, monkeypatch):
    # By hand: where friction is open by three times the noise of the fit, a sample counts for a tenth.
    problem, (series,) = steady
    seen(monkeypatch, None, None)
    stands = np.arange(len(series)) % 2 == 0
    level = 3.0 * problem.weights.floor[0]
    standing = np.column_stack([np.where(stands, level, 0.0), np.zeros(len(series))])
    columns = replace(problem.columns, standstill_std=(standing,))
    noise = np.column_stack([np.where(stands, 0.9, 0.1), series[:, 1]])
    floor = floor_by_predictors(replace(problem, columns=columns), (noise,), like(steady, 9.0, 9.0), sure(steady))
    assert floor.value[0] == pytest.approx(np.sqrt((0.1 * 0.81 + 0.01) / 1.1), rel=0.01)


def test_what_friction_in_doubt_leaves_counts_with_the_weights_of_the_figures(steady):
    # By hand: a third of the samples is in doubt, and counts for a tenth of the others.
    problem, (series,) = steady
    stands = np.arange(len(series)) % 3 == 0
    standing = np.column_stack([np.where(stands, 3.0 * problem.weights.floor[0], 0.0), np.zeros(len(series))])
    problem = replace(problem, columns=replace(problem.columns, standstill_std=(standing,)))
    residual, doubt = (np.column_stack([np.where(stands, size, 0.0), np.zeros(len(series))]) for size in (0.5, 1.0))
    floor = np.array([0.1, 0.2])
    more = uncertain_squares(problem, (series,), (residual,), (doubt,), floor, np.array([9.0, 9.0]))
    assert more == pytest.approx([0.25 * 0.1 / (0.1 + 2.0), 0.0], rel=0.02)


BEFORE = Floor(np.array([5.0, 6.0]), np.array([4.0, 5.0]), np.array([6.0, 7.0]), ("predictors", "predictors"))
SENSED = SensorFloor(*(np.array([x, np.nan]) for x in (0.2, 0.1, 0.3, 0.2)), np.zeros(2), np.zeros(2))


@pytest.fixture
def floor(quiet):
    made = replace(sensor_floors(quiet.problem), floor=SENSED)

    def of(before=BEFORE, rising=0.0):
        nothing = tuple(np.zeros_like(part) for part in quiet.noise)
        of_sensors = replace(made, floor=replace(SENSED, limit_if_rising=np.array([rising, 0.0])))
        return floor_by_sensors(before, of_sensors, quiet.problem, quiet.noise, nothing, nothing)

    return of


@pytest.mark.parametrize(
    ("before", "row", "value", "low", "source"),
    [
        (BEFORE, 0, 0.2, 0.1, SENSORS),
        (BEFORE, 1, 6.0, 5.0, NONE),
        (replace(BEFORE, value=np.array([0.15, 6.0]), low=np.array([0.1, 5.0])), 0, 0.15, 0.1, SENSORS),
        (replace(BEFORE, value=np.array([0.25, 6.0])), 0, 0.25, 0.1, SENSORS),
        (replace(BEFORE, source=(REPETITIONS, "predictors")), 0, 5.0, 4.0, REPETITIONS),
    ],
    ids=["theirs", "none show it", "predictors go below", "predictors inside their interval", "repetitions are best"],
)
def test_sensors_set_the_floor_where_they_show_it_and_nothing_better_does(floor, before, row, value, low, source):
    found = floor(before)
    assert (found.value[row], found.low[row], found.source[row]) == (value, low, source)


@pytest.mark.parametrize(
    ("before", "rising", "value", "source"),
    [
        (BEFORE, 5.5, 5.0, NONE),
        (BEFORE, 4.5, 0.2, SENSORS),
        (replace(BEFORE, value=np.array([0.25, 6.0])), 5.5, 0.25, SENSORS),
    ],
    ids=["may be that noise", "more than it can make", "no more than above the motion"],
)
def test_sensors_do_not_show_noise_that_rises_towards_the_motion(floor, before, rising, value, source):
    # By hand: on the first joint predictors leave 5 or 0.25, and white noise as above the motion makes 0.3 at most.
    found = floor(before, rising)
    assert (found.value[0], found.source[0]) == (value, source)


def test_the_upper_end_holds_what_derivatives_are_wrong_by(floor, quiet):
    # By hand: a thousandth of the torque beside the upper end of the sensors.
    torque = residual_sums(quiet.problem, measured_torque(quiet.problem)).rms()[0]
    assert floor().high[0] == pytest.approx(np.hypot(0.3, 0.001 * torque))


def test_what_is_allowed_holds_the_discrepancy(floor):
    found = floor()
    assert np.all(found.discrepancy > 0)
    np.testing.assert_allclose(found.allowed, np.hypot(found.high, found.discrepancy))


def test_samples_count_where_blocks_are_judged_and_nowhere_else(quiet):
    # By hand: cores of the judged blocks are all that figures of a gap are made of.
    squares = residual_sums(quiet.problem, tuple(np.ones_like(part) for part in quiet.noise))
    counts = sum(part.sum(axis=0) for part in judged_weights(quiet.problem))
    np.testing.assert_allclose(counts, squares.counts.sum(axis=0))
