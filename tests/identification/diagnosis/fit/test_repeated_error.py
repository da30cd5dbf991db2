import numpy as np
import pytest
from scipy.stats import chi2

from identification.diagnosis.fit.covariance import covariance
from identification.diagnosis.fit.fitting import fit
from identification.diagnosis.fit.repeated_error import (
    STATE_GROUPS,
    equations,
    repeated_covariance,
    scatter,
    state_groups,
)
from identification.diagnosis.fit.whole_model import lay_out, linearised
from identification.diagnosis.judge.judged_band import plain_search

BLOCKS = 12


@pytest.fixture
def design(rng):
    """Slopes of 480 equations in three numbers, the group of each by its first column, and its block."""
    speed = rng.uniform(-1.0, 1.0, 480)
    slopes = np.column_stack([np.ones(480), speed, rng.standard_normal(480)])
    return slopes, state_groups(speed), np.repeat(np.arange(BLOCKS), 480 // BLOCKS)


def left_by_fit(slopes, torque):
    return torque - slopes @ np.linalg.lstsq(slopes, torque, rcond=None)[0]


def sandwich(slopes, blocks, residual, repeated):
    """The covariance that is stated for a linear fit."""
    a = np.array([slopes[blocks == k].T @ slopes[blocks == k] for k in range(BLOCKS)])
    b = np.array([slopes[blocks == k].T @ residual[blocks == k] for k in range(BLOCKS)])
    return covariance(a, b, np.zeros(3), np.zeros(3), np.arange(3), repeated)


@pytest.mark.parametrize("clusters", ["states", "blocks", "both"])
def test_the_scatter_of_white_noise_is_that_of_least_squares_on_average(design, clusters):
    # Closed form: the scatter is quadratic in the residual (I - H) e, so its mean over white e is a sum over samples.
    slopes, states, blocks = design
    labels = {"states": states, "blocks": blocks, "both": BLOCKS * states + blocks}[clusters]
    inverse = np.linalg.inv(slopes.T @ slopes)
    known = slopes @ np.linalg.cholesky(inverse)
    remaining = np.eye(len(slopes)) - slopes @ inverse @ slopes.T
    mean = sum(scatter(known, one, labels) for one in remaining)
    np.testing.assert_allclose(mean, np.eye(3), atol=1e-9)


@pytest.mark.nightly
def test_white_noise_comes_again_as_rarely_as_a_normal_number_is_a_deviation_off(design, rng):
    # Closed form: a sum of four squares of normal numbers less its mean is more than its deviation in 15 % of cases
    # (chi-square law of four degrees of freedom: more than 4 + sqrt(8)).
    slopes, states, blocks = design
    seen = [
        repeated_covariance(slopes, left_by_fit(slopes, one), slopes.T @ slopes, (states,), blocks)[2, 2] > 0
        for one in rng.standard_normal((1000, len(states)))
    ]
    assert np.mean(seen) == pytest.approx(chi2.sf(4.0 + np.sqrt(8.0), 4), abs=0.04)


def test_what_comes_again_at_a_state_widens_a_number_as_it_scatters_over_robots(design, rng):
    # Closed form: robots whose torque is off by u at each state, the same in all blocks, scatter by M^-1 S^T S M^-1 u^2
    # beyond the noise, with the sums S of the slopes over each state.
    slopes, states, blocks = design
    off = 0.3
    inverse = np.linalg.inv(slopes.T @ slopes)
    sums = np.array([slopes[states == g].sum(axis=0) for g in range(STATE_GROUPS)])
    truth = np.diag(inverse + off**2 * inverse @ sums.T @ sums @ inverse)
    stated, blind = np.zeros(3), np.zeros(3)
    for _ in range(200):
        torque = off * rng.standard_normal(STATE_GROUPS)[states] + rng.standard_normal(len(states))
        residual = left_by_fit(slopes, torque)
        repeated = repeated_covariance(slopes, residual, slopes.T @ slopes, (states,), blocks)
        stated += np.diag(sandwich(slopes, blocks, residual, repeated)) / 200
        blind += np.diag(sandwich(slopes, blocks, residual, np.zeros((3, 3)))) / 200
    assert truth[1] > 5.0 * blind[1]  # blocks cannot see it
    assert stated[1] == pytest.approx(truth[1], rel=0.3)
    assert truth[2] < stated[2] < 1.5 * truth[2]  # no state has much to do with it


def test_noise_that_lasts_within_blocks_is_not_counted_twice(design, rng):
    # Monte Carlo truth: fits to noise with an offset of its own in each block.
    slopes, states, blocks = design
    stated, found = np.zeros(3), []
    for _ in range(200):
        torque = rng.standard_normal(BLOCKS)[blocks] + rng.standard_normal(len(blocks))
        residual = left_by_fit(slopes, torque)
        repeated = repeated_covariance(slopes, residual, slopes.T @ slopes, (states,), blocks)
        stated += np.diag(sandwich(slopes, blocks, residual, repeated)) / 200
        found.append(np.linalg.lstsq(slopes, torque, rcond=None)[0])
    np.testing.assert_allclose(stated, np.var(found, axis=0), rtol=0.4)


def test_a_number_that_one_sample_alone_decides_is_left_as_it_is(design):
    # Closed form: the residual of what is fitted exactly is zero; noise gives the number a variance of one.
    slopes, states, blocks = design
    slopes = np.column_stack([slopes, (np.arange(len(states)) == 7).astype(float)])
    residual = left_by_fit(slopes, np.sin(np.arange(len(states))))
    assert repeated_covariance(slopes, residual, slopes.T @ slopes, (states,), blocks)[3, 3] < 0.01


def fitted_as_coulomb(lab, robot, motion, effect, *numbers):
    """Equations of a fit of Coulomb friction on the elbow to another effect there, its products, and its place."""
    torque = lab.acting(robot, motion, effect, "elbow", *numbers)
    prepared = lab.prepared(robot, (lab.recording(robot, motion, torque),), white=False)
    problem = plain_search(prepared.search, prepared.noise).problem
    terms = tuple(t for t in prepared.columns.terms if t.effect_joint == ("coulomb_friction", "elbow"))
    layout, x = lay_out(problem, terms, fit(problem, terms, held_out=False))
    given = equations(layout, linearised(layout, x))
    known = np.where(np.arange(layout.size) < problem.nuisance_count, problem.precision[: layout.size], 0.0)
    total = given.slopes.T @ given.slopes + np.diag(known)
    return given, total, layout.term_slices[0].coefficients.start


def more_of_it(given, total, at):
    """Variance of a number by what comes again at the same state, in the noise model's variance."""
    more = repeated_covariance(given.slopes, given.residual, total, given.states, given.blocks)
    return more[at, at] / np.linalg.inv(total)[at, at]


def test_a_joint_is_at_a_state_of_its_own_in_every_equation(lab, planar2):
    # Known truth: two joints, four groups each, of equally many samples.
    given, _, _ = fitted_as_coulomb(lab, planar2, lab.motion(2, 4), "coulomb_friction", 0.6)
    for states in given.states:
        members = np.unique(states, return_counts=True)[1]
        assert len(members) == 2 * STATE_GROUPS
        assert np.ptp(members) <= 1


def test_a_law_that_is_not_exact_makes_its_size_less_certain(lab, planar2):
    # Known truth: friction that falls with speed, reported as Coulomb friction; and Coulomb friction itself.
    motion = lab.motion(2, 4, seconds=20.0, swing=1.5)
    exact = more_of_it(*fitted_as_coulomb(lab, planar2, motion, "coulomb_friction", 0.6))
    falling = more_of_it(*fitted_as_coulomb(lab, planar2, motion, "stribeck_friction", 0.3, 0.9, 0.3))
    assert exact < 1.0
    assert falling > 5.0 * exact + 1.0


def test_a_joint_without_samples_has_no_states():
    assert state_groups(np.zeros(0)).shape == (0,)
