"""Fresh encoder noise on a recording. Oracle: lattices and noises that are known because they were put in.

White noise of the torque balance above the motion. Oracle: closed forms of white noise, known truths.
"""

from dataclasses import replace

import numpy as np
import pytest

from identification.data.derivatives import differentiate, motion_edge
from identification.data.signals import process, process_all
from identification.diagnosis.columns.residual_columns import columns_like
from identification.diagnosis.fit.fitting import fit
from identification.diagnosis.fit.problem import set_up
from identification.diagnosis.noise.balance_noise import (
    SubBand,
    balance_bands,
    balance_noise,
    band_passed,
    rising_density,
)
from identification.diagnosis.noise.encoder_noise import (
    _null_problem,
    at_least_encoder_noise,
    coarse_joints,
    coarsest_steps,
    simulated_log,
    simulated_recordings,
    spurious_gains,
)
from identification.diagnosis.noise.noise_floor import rms
from identification.diagnosis.noise.reading_noise import ReadingNoise
from identification.diagnosis.noise.whitening import whitened
from phantom_dyn.effects.support.encoder_lattice import reading_step

STEP = 2e-3


def stating(prepared, step: float | None):
    """The session of a robot whose file states that step for both joints."""
    counts = None if step is None else 2.0 * np.pi / step
    robot = prepared.session.robot
    actuators = tuple(replace(one, encoder_counts=counts) for one in robot.actuators)
    return replace(prepared.session, robot=replace(robot, actuators=actuators))


def test_an_encoder_with_steps_is_read_on_a_lattice_about_the_motion(quiet, rng):
    log = quiet.logs[0]
    simulated = simulated_log(log, quiet.columns.operations[0], (STEP, STEP), rng)
    levels = simulated.raw_q / STEP
    np.testing.assert_allclose(levels - levels[0], np.round(levels - levels[0]), atol=1e-6)
    off = simulated.raw_q - log.motion.q
    assert np.abs(off).max() <= 0.5 * STEP + 1e-12
    # Closed form: rounding to a step is uniform over it.
    assert off.std(axis=0) == pytest.approx(STEP / np.sqrt(12.0), rel=0.05)


def test_an_encoder_without_steps_has_the_noise_that_smoothing_took_off_at_another_time(quiet, rng):
    log = quiet.logs[0]
    simulated = simulated_log(log, quiet.columns.operations[0], (None, None), rng)
    old, new = log.raw_q - log.motion.q, simulated.raw_q - log.motion.q
    np.testing.assert_allclose(np.sort(new, axis=0), np.sort(old, axis=0), atol=1e-15)
    for j in range(2):
        count = len(old)
        found = [shift for shift in range(count // 4, count // 2) if np.allclose(np.roll(old[:, j], shift), new[:, j])]
        assert len(found) == 1


def test_a_simulated_recording_is_driven_by_the_torque_of_the_model(quiet, rng):
    operation = quiet.columns.operations[0]
    simulated = simulated_log(quiet.logs[0], operation, (None, None), rng)
    np.testing.assert_array_equal(simulated.tau, operation.tau)


@pytest.mark.parametrize("times", [1.0, 3.0])
def test_the_step_of_readings_is_that_of_their_lattice(lab, planar2, times):
    q = lab.motion(2).q[:, 0]
    assert reading_step(np.round(q / (times * STEP)) * times * STEP, STEP) == pytest.approx(times * STEP, rel=2e-3)


def test_the_step_of_several_recordings_is_the_coarsest_and_none_where_one_has_none(lab, planar2):
    smooth = lab.recording(planar2, lab.motion(2), noise=0.0)
    fine, coarse = (replace(smooth, q=np.round(smooth.q / step) * step) for step in (STEP, 2 * STEP))
    logs = {name: process(one, planar2) for name, one in (("fine", fine), ("coarse", coarse), ("smooth", smooth))}
    assert coarsest_steps((logs["fine"], logs["coarse"])) == pytest.approx((2 * STEP, 2 * STEP), rel=2e-3)
    assert coarsest_steps((logs["fine"], logs["smooth"])) == (None, None)


@pytest.mark.parametrize(
    ("step", "stated", "rows"),
    [(None, STEP, []), (STEP, None, []), (1.4 * STEP, STEP, []), (1.6 * STEP, STEP, [1])],
    ids=["no lattice", "nothing stated", "hardly coarser", "coarser"],
)
def test_a_joint_is_coarse_where_its_step_is_half_as_large_again_as_stated(quiet, step, stated, rows):
    found = coarse_joints(stating(quiet, stated), quiet.columns, (None, step))
    assert [one.row for one in found] == rows


@pytest.mark.parametrize(
    ("steps", "rows"),
    [((STEP / 9, STEP), []), ((STEP / 11, STEP), [1]), ((STEP, STEP / 11), [0]), ((None, STEP), [])],
    ids=["nine times", "eleven times", "of the other joint", "other joint on no lattice"],
)
def test_without_a_stated_step_a_joint_is_coarse_beside_far_finer_ones(quiet, steps, rows):
    found = coarse_joints(stating(quiet, None), quiet.columns, steps)
    assert [one.row for one in found] == rows


def test_a_lower_low_pass_takes_the_torque_of_rounding_away(quiet):
    # A low pass at a tenth of the band's edge leaves less than half of what rounding makes of accelerations.
    session = stating(quiet, STEP / 2)
    (log,) = session.logs
    edges = np.full(2, 0.1 * motion_edge(log.band))
    motion = log.motion.with_joints(*differentiate(log.raw_q, log.band.rate_hz, edges))
    session = replace(session, logs=(replace(log, motion=motion, position_edges=edges),))
    (one,) = coarse_joints(session, quiet.columns, (None, STEP))
    left, plain = (rms([part[:, 1] for part in torque]) for torque in (one.torque, one.usual_low_pass))
    assert left < 0.5 * plain


def test_the_torque_of_rounding_lacks_what_the_stated_step_would_make(quiet):
    # Closed form: squares of noises add, so a step h stated as s makes sqrt(1 - (s / h)^2) of what it would alone.
    torques = []
    for stated in (1e-9, 0.6 * STEP):
        ((elbow,),) = (coarse_joints(stating(quiet, stated), quiet.columns, (None, STEP)),)
        torques.append(elbow.torque[0])
    np.testing.assert_allclose(torques[1], 0.8 * torques[0], rtol=1e-9)
    assert rms([torques[0][:, 1]]) > 0


def test_noise_below_that_of_the_encoders_is_taken_for_theirs(quiet, rng):
    # Known truth: the encoders make three times the noise of the shoulder, and a third of that of the elbow.
    use = quiet.columns.usable
    noise = (np.where(use[0], rng.normal(size=use[0].shape), 0.0),)
    encoders = rng.normal(size=use[0].shape) * [3.0, 1.0 / 3.0]
    (out,) = at_least_encoder_noise(noise, (encoders,), use)
    np.testing.assert_array_equal(out[:, 0], np.where(use[0][:, 0], encoders[:, 0], 0.0))
    np.testing.assert_array_equal(out[:, 1], noise[0][:, 1])


def test_a_simulated_recording_has_no_gap_but_the_noise_of_its_encoders(quiet):
    # Known truth: the model drives it, so that nothing is left where nothing is rounded; three times the step leaves
    # three times as much.
    left = []
    for step in (1e-12, STEP, 3 * STEP):
        simulated = simulated_recordings(quiet.session, quiet.columns, (step, step))
        left.append(rms([simulated.residual[0][:, 1][quiet.columns.usable[0][:, 1]]]))
        columns = columns_like(simulated.session, quiet.columns)
        assert columns.terms == quiet.columns.terms
        np.testing.assert_allclose(simulated.residual[0], columns.residual[0], atol=1e-12)
    assert left[0] < 0.05 * left[1]
    assert left[2] / left[1] == pytest.approx(3.0, rel=0.3)


def test_what_encoder_noise_alone_lets_an_effect_gain_is_what_its_fit_takes_off(quiet):
    # The fits of the search on the readings with fresh noise; effects that have one shape and no bounds, so that the
    # gain is a square.
    simulated = simulated_recordings(quiet.session, quiet.columns, (STEP, STEP))
    found = spurious_gains(quiet.search, simulated, quiet.noise)
    columns = columns_like(simulated.session, quiet.columns)
    null = set_up(quiet.session, columns, whitened(columns, quiet.noise)[0], quiet.weights)
    base = fit(null, (), held_out=False).objective
    for joint in ("shoulder", "elbow"):
        alone = fit(null, (quiet.term("torque_offset", joint),), held_out=False).objective
        assert found["torque_offset", joint] == pytest.approx(base - alone, rel=1e-3, abs=1e-3)
    assert min(found.values()) >= 0.0


def test_products_that_are_made_log_by_log_are_those_of_all_logs_together(lab, planar2):
    # Oracle: the columns of both recordings at once.
    both = lab.prepared(planar2, tuple(lab.recording(planar2, lab.motion(2, seed), seed=seed) for seed in range(2)))
    simulated = simulated_recordings(both.session, both.columns, (STEP, STEP))
    found = _null_problem(both.problem, simulated, both.noise)
    columns = columns_like(simulated.session, both.columns)
    expected = set_up(both.session, columns, whitened(columns, both.noise)[0], both.weights)
    scale = np.sqrt(np.outer(*2 * (np.diag(expected.total_a),))) + 1e-12
    np.testing.assert_allclose(found.total_a / scale, expected.total_a / scale, atol=1e-12)
    np.testing.assert_allclose(found.total_b, expected.total_b, atol=1e-12 * np.abs(expected.total_b).max())
    np.testing.assert_allclose(found.precision, expected.precision, rtol=1e-12)


def test_an_effect_of_many_shapes_gains_what_the_best_of_them_gains(quiet):
    simulated = simulated_recordings(quiet.session, quiet.columns, (STEP, STEP))
    place = ("stribeck_friction", "elbow")
    shapes = [term for term in quiet.search.terms if term.effect_joint == place]
    alone = [spurious_gains(replace(quiet.search, terms=(term,)), simulated, quiet.noise)[place] for term in shapes]
    assert len(shapes) > 3
    assert spurious_gains(quiet.search, simulated, quiet.noise)[place] == pytest.approx(max(alone), rel=1e-12)
    assert max(alone) > min(alone)


def test_encoders_whose_noise_is_no_matter_let_no_effect_gain(quiet):
    # Oracle: the gains themselves, which are there where they are computed.
    fine = simulated_recordings(quiet.session, quiet.columns, (1e-9, 1e-9))
    found = spurious_gains(quiet.search, fine, quiet.noise)
    assert set(found) == {term.effect_joint for term in quiet.search.terms}
    assert not any(found.values())
    coarse = simulated_recordings(quiet.session, quiet.columns, (STEP, STEP))
    assert max(spurious_gains(quiet.search, coarse, quiet.noise).values()) > 0.0


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
        return log[0], balance_bands(planar2, log[0], judged, (ReadingNoise(1e-5, 0.0),) * 2)

    return parts


def test_white_noise_keeps_its_power_between_two_frequencies(rng):
    # Closed form: sigma^2 / (rate / 2) for every hertz.
    x = rng.standard_normal((40000, 1))
    assert np.mean(band_passed(x, 500.0, 30.0, 50.0) ** 2) == pytest.approx(20.0 / 250.0, rel=0.05)


def test_a_slow_motion_leaves_nothing_between_higher_frequencies():
    t = np.arange(5000) / 500.0
    assert np.abs(band_passed(np.sin(2.0 * np.pi * 0.7 * t)[:, None], 500.0, 30.0, 50.0)[500:-500]).max() < 1e-6


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
    assert SubBand(10.0, 4.0, 1.0, 100.0).torque == 3.0


def test_the_two_lowest_parts_are_the_noise_and_the_nearest_its_upper_end():
    # By hand: what is left of the motion raises the others. Medians of so many values are sure to exp(0.1) in one
    # deviation.
    count = 100.0 / 0.37
    parts = [SubBand(f, level, 0.0, count) for f, level in ((10.0, 9.0), (20.0, 1.2), (30.0, 1.0), (40.0, 3.0))]
    seen = balance_noise(parts, 1.0)
    assert (seen.low, seen.value, seen.high) == pytest.approx((np.exp(-0.1), 1.1, 9.0 * np.exp(0.1)))


def test_noise_that_one_part_alone_has_is_not_white():
    # By hand: a resonance at 20 Hz has far more power than the parts about it, in which white noise would be, too.
    parts = [SubBand(f, level, 0.0, 1e6) for f, level in ((10.0, 1.0), (20.0, 20.0), (40.0, 30.0))]
    seen = balance_noise(parts, 0.0)
    assert (seen.low, seen.value, seen.high) == (1.0, 1.0, 1.0)


def test_white_noise_is_no_larger_than_a_part_that_is_mostly_the_encoders():
    # By hand: the part next to the motion has a power of 1 in all, whatever it is made of.
    seen = balance_noise([SubBand(10.0, 1.0, 0.8, 1e6), SubBand(20.0, 2.0, 0.0, 1e6)], 0.0)
    assert (seen.low, seen.value, seen.high) == (0.0, 1.0, 1.0)


def test_noise_that_the_encoders_hide_need_not_be_there_and_is_three_tenths_of_theirs_at_most():
    # By hand: a quarter of the largest size is a sixteenth of its power.
    seen = balance_noise([SubBand(10.0, 1.0, 1.1, 1e6), SubBand(20.0, 16.0, 15.0, 1e6)], 0.0)
    assert (seen.value, seen.low, seen.high) == pytest.approx((0.3 / 16.0, 0.0, 0.3))


def test_noise_that_falls_by_the_square_of_the_frequency_may_rise_so_in_the_band():
    # Closed form: the mean from 0.1 to 5 Hz of 4 (10/f)^2, over 5 Hz.
    parts = [SubBand(10.0, 4.0, 0.0, 1e6), SubBand(20.0, 1.0, 0.0, 1e6), SubBand(40.0, 9.0, 0.0, 1e6)]
    rises, mean = rising_density(parts, 5.0, 0.1, 0.0)
    assert rises
    assert mean == pytest.approx(400.0 / 5.0 * (1.0 / 0.1 - 1.0 / 5.0), rel=1e-2)


def test_noise_that_falls_by_less_rises_by_less():
    # Closed form: it halves from 10 to 20 Hz, as 4 (10/f).
    parts = [SubBand(10.0, 4.0, 0.0, 1e6), SubBand(20.0, 2.0, 0.0, 1e6)]
    rises, mean = rising_density(parts, 5.0, 0.1, 0.0)
    assert rises
    assert mean == pytest.approx(40.0 / 5.0 * np.log(5.0 / 0.1), rel=1e-2)


@pytest.mark.parametrize(
    "parts",
    [
        [SubBand(10.0, 2.0, 0.0, 10.0), SubBand(20.0, 1.0, 0.0, 10.0)],
        [SubBand(10.0, 1.0, 0.0, 1e6), SubBand(20.0, 4.0, 0.0, 1e6)],
        [SubBand(10.0, 4.0, 3.0, 1e6), SubBand(20.0, 1.0, 0.0, 1e6)],
        [SubBand(10.0, 4.0, 0.0, 1e6), SubBand(20.0, 5.0, 4.0, 1e6)],
        [SubBand(10.0, 4.0, 0.0, 1e6)],
    ],
    ids=["within its uncertainty", "falls", "hidden near the motion", "hidden above", "one part"],
)
def test_noise_that_is_not_seen_to_rise_does_not(parts):
    assert not rising_density(parts, 5.0, 0.1, 2.0)[0]


def test_without_a_part_nothing_is_known():
    assert balance_noise([], 2.0) is None


def test_a_motion_that_reaches_up_to_the_rate_leaves_no_parts(parts_of, planar2):
    log, _ = parts_of()
    assert balance_bands(planar2, log, 0.4 * log.band.rate_hz, (None, None)) == ([], [])
