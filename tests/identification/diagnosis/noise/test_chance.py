from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import gumbel_r

from identification.diagnosis.fit.fitting import fit
from identification.diagnosis.fit.problem import Problem, set_up
from identification.diagnosis.noise import chance
from identification.diagnosis.noise.chance import _null_products, null_threshold
from identification.diagnosis.search.search import price
from identification.engine.fits.held_out_gains import gains_on_residuals
from identification.gates import above_chance

FRICTION = ("viscous_friction", "coulomb_friction", "torque_offset")


def gains(prepared) -> np.ndarray:
    """What each rival gains on held-out data, less what it has to pay beyond one parameter."""
    search = prepared.search
    base = fit(prepared.problem, ()).total
    return np.array(
        [
            base
            - fit(prepared.problem, (term,)).total
            - max(price(search.counts[term]) - above_chance.PARAMETER_PRICE, 0.0)
            for term in search.terms
        ]
    )


def test_the_threshold_is_the_same_on_every_call(quiet):
    assert null_threshold(quiet.search, quiet.filters, quiet.noise) == null_threshold(
        quiet.search, quiet.filters, quiet.noise
    )


def test_no_effect_gains_the_threshold_where_there_is_no_gap(lab, planar2):
    # Known truth: recordings without a gap; each exceeds the quantile in one of a hundred.
    for seed in range(4):
        prepared = lab.prepared(planar2, (lab.recording(planar2, lab.motion(2, seed), seed=seed),))
        assert gains(prepared).max() < null_threshold(prepared.search, prepared.filters, prepared.noise).overall


def test_an_effect_gains_more_than_the_threshold(lab, planar2):
    motion = lab.motion(2, 3)
    prepared = lab.prepared(planar2, (lab.recording(planar2, motion, -np.sign(motion.v) * [0.0, 0.3]),))
    assert gains(prepared).max() > 3 * null_threshold(prepared.search, prepared.filters, prepared.noise).overall


def test_a_threshold_is_exceeded_by_chance_in_one_of_a_hundred_recordings(quiet, monkeypatch, rng):
    # Oracle: SciPy's Gumbel law with the mean and deviation of the largest gains; five thousand recordings, so that the
    # law itself exceeds it in 0.8 to 1.2 %. Each of two joints is to be wrong half as often.
    terms = tuple(quiet.term("coulomb_friction", joint) for joint in ("shoulder", "elbow"))
    drawn = rng.gumbel(10.0, 3.0, (2, 5000))
    monkeypatch.setattr(chance, "gains_on_residuals", lambda *_: drawn)
    threshold = null_threshold(replace(quiet.search, terms=terms), quiet.filters, quiet.noise)

    def quantile(best: np.ndarray, level: float) -> float:
        scale = best.std() * np.sqrt(6) / np.pi
        return float(gumbel_r.ppf(level, best.mean() - np.euler_gamma * scale, scale))

    assert threshold.overall == pytest.approx(quantile(drawn.max(axis=0), 0.99))
    assert np.mean(drawn.max(axis=0) > threshold.overall) == pytest.approx(0.01, abs=0.003)
    wanted = {joint: quantile(own, 0.995) for joint, own in zip(("shoulder", "elbow"), drawn, strict=True)}
    assert threshold.joints == pytest.approx(wanted)


def test_twice_the_noise_of_a_trusted_model_gains_four_times_as_much_by_chance(lab, planar2, trusted):
    # Gains are quadratic in the noise where nothing else is drawn; prices are not, so the rivals are those of one
    # parameter. The timing of the torque has a prior of its own: rivals that look like it are left out.
    robot = trusted(planar2)
    prepared = lab.prepared(robot, (lab.recording(robot, lab.motion(2)),))
    search = prepared.search
    search = replace(search, terms=tuple(term for term in search.terms if term.effect.name in FRICTION))
    once = null_threshold(search, prepared.filters, prepared.noise).overall
    twice = null_threshold(search, prepared.filters, tuple(2 * part for part in prepared.noise)).overall
    assert twice == pytest.approx(4 * once, rel=1e-2)


def test_more_rivals_gain_more_by_chance(quiet):
    few = replace(quiet.search, terms=quiet.search.terms[:2])
    assert (
        null_threshold(few, quiet.filters, quiet.noise).overall
        < null_threshold(quiet.search, quiet.filters, quiet.noise).overall
    )


def test_noise_that_nothing_explains_on_one_joint_leaves_the_thresholds_of_others(lab, planar2):
    # Known truth: bursts on the shoulder that no effect makes; on the elbow nothing but white noise, as without them.
    motion = lab.motion(2, 4)
    bursts = np.random.default_rng(0).standard_normal(len(motion.t)) * (np.sin(2 * np.pi * 0.31 * motion.t) > 0.9)
    prepared = lab.prepared(planar2, (lab.recording(planar2, motion, bursts[:, None] * [30.0, 0.0]),))
    plain = lab.prepared(planar2, (lab.recording(planar2, motion),))
    threshold = null_threshold(prepared.search, prepared.filters, prepared.noise)
    without = null_threshold(plain.search, plain.filters, plain.noise)
    elbow = prepared.term("coulomb_friction", "elbow")
    shoulder = prepared.term("coulomb_friction", "shoulder")
    # A quantile of the 80 maxima that are drawn scatters by a tenth itself.
    assert threshold.joints["elbow"] < 1.25 * without.joints["elbow"]
    assert threshold.of(shoulder, elbow) == max(threshold.of(shoulder), threshold.of(elbow))


def test_a_threshold_is_nowhere_above_the_overall_one(quiet):
    threshold = null_threshold(quiet.search, quiet.filters, quiet.noise)
    assert all(threshold.of(term) <= threshold.overall for term in quiet.search.terms)


def test_a_threshold_is_never_below_the_least(quiet):
    threshold = null_threshold(quiet.search, quiet.filters, quiet.noise, 500.0)
    assert {threshold.overall, *threshold.joints.values()} == {500.0}


class Known:
    """Draws that are known: every ``turned``-th block changes its sign, every change is a share of its deviation."""

    def __init__(self, share: float, turned: int = 1000):
        self.share, self.turned = share, turned

    def choice(self, values, size):
        chosen = np.array(values)[(np.arange(size[0]) % self.turned != self.turned - 1).astype(int)]
        return np.tile(chosen[:, None], (1, size[1]))

    def normal(self, size):
        return np.full(size, self.share)


def with_residual(problem: Problem, residual: np.ndarray) -> Problem:
    """The same problem with another white residual."""
    white = replace(problem.white, residual=(residual,))
    return set_up(problem.session, problem.columns, white, problem.weights)


@pytest.mark.parametrize("share", [0.0, 0.7, -50.0])
def test_a_null_recording_is_noise_and_moves_within_their_bounds(quiet, share):
    # Brute force: products of the columns with the noise plus what the changes leave on each row.
    problem = quiet.problem
    changes = np.array([np.clip(share * n.sigma, -n.bound, n.bound) for n in problem.white.tolerance_parameters])
    residual = quiet.noise[0].copy()
    for j, index in enumerate(problem.columns.rows):
        own = [k for k, column in enumerate(index) if column < len(changes)]
        residual[:, j] += problem.white.values[0][j][:, own] @ changes[[index[k] for k in own]]
    expected = with_residual(problem, residual).grams
    b, core_b = _null_products(problem, quiet.filters, quiet.noise, Known(share))
    scale = np.abs(expected.b).max(axis=0) + 1e-9
    np.testing.assert_allclose(b[:, :, 3] / scale, expected.by_fold(expected.b) / scale, atol=1e-9)
    np.testing.assert_allclose(core_b[:, :, 3] / scale, expected.by_fold(expected.core_b) / scale, atol=1e-9)


def test_blocks_change_their_sign_as_a_whole(quiet):
    # Oracle: products of each block with the noise itself.
    grams = with_residual(quiet.problem, quiet.noise[0]).grams
    sign = np.where(np.arange(len(quiet.blocks)) % 2 == 1, -1.0, 1.0)[:, None]
    turned = _null_products(quiet.problem, quiet.filters, quiet.noise, Known(0.0, 2))
    for found, by_block in zip(turned, (grams.b, grams.core_b), strict=True):
        expected = grams.by_fold(sign * by_block)
        np.testing.assert_allclose(found[:, :, 0], expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


def test_a_rival_gains_on_a_null_recording_what_its_fits_gain(quiet):
    # The fits of the search on the noise itself, for rivals that have no bounds.
    search = quiet.search
    terms = tuple(quiet.term(name, joint) for name in ("torque_offset", "encoder_offset") for joint in ("elbow",))
    terms += (quiet.term("torque_offset", "shoulder"),)
    problem = with_residual(quiet.problem, quiet.noise[0])
    base = fit(problem, ()).total
    expected = [base - fit(problem, (term,)).total for term in terms]
    products = _null_products(search.problem, quiet.filters, quiet.noise, Known(0.0))
    found = gains_on_residuals(search.problem, [term.columns for term in terms], *products)[:, 0]
    # Bounds of the nuisances are left out, which changes little.
    np.testing.assert_allclose(found, expected, rtol=0.02, atol=1e-3)
