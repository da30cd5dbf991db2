from dataclasses import replace

import numpy as np
import pytest

from identification.diagnosis.fit.gap import held_out_torque
from identification.diagnosis.noise.noise_floor import (
    estimate_noise,
    noise_floor,
    noise_without_remainder,
    rms,
    smaller_noise,
    smaller_noise_in_band,
    weights_of,
)


def test_the_root_mean_square_is_over_all_series():
    assert rms([np.array([3.0]), np.array([4.0, 0.0])]) == pytest.approx(np.sqrt(25 / 3))


def test_no_samples_have_no_size():
    assert rms([np.zeros(0)]) == 0.0


def added(prepared, level: float) -> float:
    """Closed form: white noise, of which the band lets its share of the power through."""
    return level * np.sqrt(np.sum(prepared.logs[0].band.kernel ** 2))


def test_the_floor_is_the_noise_that_was_added_or_little_more(lab, planar2):
    # Known truth: 0.05 at 200 Hz; fits of the whole catalogue to 30 s leave a quarter more at most.
    recording = lab.recording(planar2, lab.motion(2, seconds=30.0), noise=0.05)
    prepared = lab.prepared(planar2, (recording,), white=False)
    ratio = prepared.weights.floor / added(prepared, 0.05)
    assert np.all((ratio > 0.95) & (ratio < 1.25))


def test_the_noise_holds_nothing_of_an_effect_of_the_catalogue(lab, planar2):
    # Known truth: the same noise beside friction of ten times its size, which the model lacks.
    motion = lab.motion(2, seconds=20.0)
    recording = lab.recording(planar2, motion, -0.5 * np.sign(motion.v))
    prepared = lab.prepared(planar2, (recording,), white=False)
    assert np.all(prepared.weights.floor < 1.35 * added(prepared, 0.05))


def test_the_explanation_brings_the_floor_down_to_the_noise_that_was_added(lab, planar2):
    # Known truth: 0.05, with friction on both joints that the explanation names; exact positions.
    motion = lab.motion(2, seconds=20.0)
    recording = replace(lab.recording(planar2, motion, -0.5 * np.sign(motion.v)), q=motion.q)
    prepared = lab.prepared(planar2, (recording,))
    chosen = frozenset(prepared.term("coulomb_friction", joint) for joint in planar2.joint_names)
    first = estimate_noise(prepared.session, prepared.columns)[0]
    noise, _ = smaller_noise(prepared.search, chosen, first)
    floor = [rms([noise[0][prepared.columns.usable[0][:, j], j]]) for j in range(2)]
    np.testing.assert_allclose(floor, added(prepared, 0.05), rtol=0.1)


def test_noise_is_zero_where_samples_are_not_used(quiet):
    noise = estimate_noise(quiet.session, quiet.columns)[0][0]
    assert not noise[~quiet.columns.usable[0]].any()


def test_a_robot_without_noise_keeps_finite_weights(quiet):
    weights = weights_of(quiet.columns, (np.zeros_like(quiet.columns.residual[0]),))
    np.testing.assert_allclose(weights.floor, 1e-6 * quiet.columns.model_torque[0].std(axis=0))
    np.testing.assert_array_equal(weights.spread, 1.0)


def test_an_explanation_that_leaves_less_than_the_noise_replaces_it(lab, planar2):
    # Known truth: no gap and noise of 0.05; a noise that is taken three times too large comes down again.
    prepared = lab.prepared(planar2, (lab.recording(planar2, lab.motion(2)),))
    given = tuple(3 * part for part in prepared.noise)
    noise, ratio = smaller_noise(prepared.search, frozenset(), given)
    band = prepared.logs[0].band
    assert ratio < 0.5
    left = noise[0][prepared.columns.usable[0][:, 1], 1]
    assert np.std(left) == pytest.approx(0.05 * np.sqrt(np.sum(band.kernel**2)), rel=0.15)


def test_an_explanation_that_leaves_more_than_the_noise_changes_nothing(quiet):
    small = tuple(0.2 * part for part in quiet.noise)
    noise, ratio = smaller_noise(quiet.search, frozenset(), small)
    assert ratio == 1.0
    np.testing.assert_array_equal(noise[0], small[0])


@pytest.fixture
def rubbing(lab, planar2):
    """Friction that the model lacks on both joints, and the search that may say so."""
    motion = lab.motion(2, seconds=20.0)
    return lab.prepared(planar2, (lab.recording(planar2, motion, -0.5 * np.sign(motion.v)),))


def trace_of(prepared, chosen):
    torque = held_out_torque(prepared.problem, chosen, prepared.search.held_out_fit(chosen))
    plain = held_out_torque(prepared.problem, frozenset(), prepared.search.held_out_fit(frozenset()))
    return np.where(prepared.columns.usable[0], torque[0] - plain[0], 0.0)


def test_the_trace_of_an_effect_is_taken_out_of_the_noise(rubbing, rng):
    # Known truth: white noise with two fifths of what held-out fits of the friction predict.
    tried = frozenset([rubbing.term("coulomb_friction", "elbow")])
    noise = 0.05 * rng.standard_normal(rubbing.columns.residual[0].shape) * rubbing.columns.usable[0]
    left, gain = noise_without_remainder(
        rubbing.search, tried, frozenset(), (noise + 0.4 * trace_of(rubbing, tried) * rubbing.columns.usable[0],)
    )
    np.testing.assert_allclose(left[0], noise, atol=0.2 * 0.05)
    assert gain > 50


def test_noise_without_a_trace_stays_as_it_is(rubbing, rng):
    # Known truth: the opposite of what the fits predict is no share of it.
    tried = frozenset([rubbing.term("coulomb_friction", "elbow")])
    noise = 0.001 * rng.standard_normal(rubbing.columns.residual[0].shape) - trace_of(rubbing, tried)
    noise *= rubbing.columns.usable[0]
    left, gain = noise_without_remainder(rubbing.search, tried, frozenset(), (noise,))
    np.testing.assert_allclose(left[0][:, 1], noise[:, 1])
    assert gain < 5


def test_the_best_predictor_in_the_judged_band_leaves_no_more_there_than_that_of_the_whole_band(quiet):
    session = replace(quiet.session, cutoff_hz=0.3 * quiet.session.logs[0].band.cutoff_hz)
    whole, inside = (noise_floor(session, quiet.columns, e) for e in estimate_noise(session, quiet.columns))
    assert np.all(inside <= whole)


def test_no_predictor_is_taken_that_is_worse_than_the_given_model(quiet):
    # Whatever is foreseen wrongly: the given model foresees nothing.
    columns = replace(quiet.columns, values=tuple(tuple(0.0 * row for row in rows) for rows in quiet.columns.values))
    noise, inside = estimate_noise(quiet.session, columns)
    given = [rms([r[:, j][u[:, j]] for r, u in zip(columns.residual, columns.usable, strict=True)]) for j in range(2)]
    for series in (noise, inside):
        left = [rms([e[:, j][u[:, j]] for e, u in zip(series, columns.usable, strict=True)]) for j in range(2)]
        assert np.all(np.array(left) <= given)


@pytest.mark.parametrize(("other", "least", "taken"), [(0.1, 0.0, True), (0.3, 0.0, False), (0.1, 0.15, False)])
def test_a_row_gets_the_noise_that_is_smaller_in_the_judged_band_and_not_below_that_of_its_encoder(
    quiet, other, least, taken
):
    # By hand: rows of constant size.
    every = tuple(np.ones_like(part) for part in quiet.noise)
    noise, inside = (tuple(size * part for part in every) for size in (0.2, other))
    out = smaller_noise_in_band(quiet.session, quiet.columns, noise, inside, np.array([least, np.inf]))
    np.testing.assert_allclose(out[0][:, 0], other if taken else 0.2)
    np.testing.assert_allclose(out[0][:, 1], 0.2)
