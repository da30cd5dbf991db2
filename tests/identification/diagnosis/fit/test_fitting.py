"""Priors of a fitting problem. Oracle: by hand."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from identification.diagnosis.fit.fitting import active_columns, fit, predict
from identification.diagnosis.fit.gap import ResidualSums, held_out_torque, judged_blocks, residual_after, residual_sums
from identification.diagnosis.fit.point_mass import point_mass_jacobian
from identification.diagnosis.fit.problem import set_up
from identification.engine.numerics.bounded import bounded_solve
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.model.inertia import point_mass_parameters
from phantom_dyn.model.robot import Tolerance


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), size=st.integers(1, 8), width=st.floats(0.01, 3.0))
def test_a_bounded_solution_is_that_of_scipy(seed, size, width):
    # scipy.optimize.lsq_linear on a random problem in which some bounds bind and some are infinite.
    rng = np.random.default_rng(seed)
    x, y = rng.normal(size=(size + 5, size)), 3 * rng.normal(size=size + 5)
    lower = np.where(rng.random(size) < 0.3, -np.inf, -width * rng.random(size))
    upper = np.where(rng.random(size) < 0.3, np.inf, width * rng.random(size) + 1e-3)
    expected = lsq_linear(x, y, (lower, upper), tol=1e-14, max_iter=500).x
    found = bounded_solve(x.T @ x, x.T @ y, lower, upper)
    np.testing.assert_allclose(found, expected, atol=1e-5 * (1 + np.abs(expected).max()))


def rows_of(prepared, blocks, active, core):
    """Weighted columns and residual of some blocks, all rows below each other."""
    x, y = [], []
    for k in blocks:
        block = prepared.blocks[k]
        part = slice(block.core if core else block.start, block.stop)
        for j, index in enumerate(prepared.white.rows):
            use = prepared.white.usable[block.log][part, j]
            full = np.zeros((use.sum(), len(prepared.white.names)))
            full[:, list(index)] = prepared.white.values[block.log][j][part][use]
            scale = np.sqrt(prepared.weights.per_sample[j])
            x.append(scale * full[:, active])
            y.append(scale * prepared.white.residual[block.log][part, j][use])
    return np.concatenate(x), np.concatenate(y)


def refitted(prepared, blocks, active):
    """lsq_linear on the samples of these blocks, priors as rows of their own."""
    problem = prepared.problem
    x, y = rows_of(prepared, blocks, active, False)
    prior = np.diag(np.sqrt(problem.precision[active]))
    bounds = (problem.lower[active], problem.upper[active])
    scale = np.linalg.norm(np.vstack([x, prior]), axis=0)
    stacked = np.vstack([x, prior]) / scale
    found = lsq_linear(
        stacked, np.concatenate([y, np.zeros(len(active))]), (bounds[0] * scale, bounds[1] * scale), tol=1e-13
    )
    return found.x / scale


def test_held_out_losses_are_those_of_fits_without_the_samples(rough):
    # Brute force: drop the samples of a fold, fit the rest with scipy, and judge the cores of the fold.
    terms = (rough.term("viscous_friction", "shoulder"), rough.term("coulomb_friction", "elbow"))
    found = fit(rough.problem, terms)
    active = active_columns(rough.problem, terms)
    for fold in (0, 5):
        rest = [k for k, mine in enumerate(rough.folds) if mine != fold]
        theta = refitted(rough, rest, active)
        np.testing.assert_allclose(found.fold_theta[fold][active], theta, rtol=1e-4, atol=1e-7)
        for k in np.flatnonzero(rough.folds == fold):
            x, y = rows_of(rough, [k], active, True)
            assert found.loss[k] == pytest.approx(np.sum((y - x @ theta) ** 2), rel=1e-5)


def test_the_fit_on_everything_is_that_of_scipy(rough):
    terms = (rough.term("viscous_friction", "shoulder"), rough.term("coulomb_friction", "elbow"))
    active = active_columns(rough.problem, terms)
    theta = refitted(rough, range(len(rough.blocks)), active)
    np.testing.assert_allclose(fit(rough.problem, terms).theta[active], theta, rtol=1e-4, atol=1e-7)


def test_known_friction_comes_back_within_three_deviations(rough):
    terms = (rough.term("viscous_friction", "shoulder"), rough.term("coulomb_friction", "elbow"))
    found = fit(rough.problem, terms)
    for term, truth in zip(terms, (0.15, 0.25), strict=True):
        at = int(np.searchsorted(found.active, term.columns[0]))
        assert abs(found.theta[term.columns[0]] - truth) < 3 * np.sqrt(found.cov[at, at])


def test_nuisances_stay_within_two_tolerances(lab, planar2):
    # Friction of 0.5 more than modelled: without a term for it the model may change by 10 % and no further.
    motion = lab.motion(2, 3)
    recording = lab.recording(planar2, motion, -np.sign(motion.v) * 0.5)
    prepared = lab.prepared(planar2, (recording,))
    found = fit(prepared.problem, ())
    changes = found.theta[: prepared.problem.nuisance_count]
    bounds = np.array([n.bound for n in prepared.columns.tolerance_parameters])
    assert np.all(np.abs(changes) <= bounds * (1 + 1e-12))
    assert np.any(np.isclose(np.abs(changes), bounds))


def test_a_fit_without_the_moves_that_cannot_be_seen_leaves_what_one_with_all_leaves(lab, planar2):
    # The same fit with every tolerance parameter in it; the noise of one sample is one.
    motion = lab.motion(2, 3)
    still = replace(motion, q=motion.q * [1.0, 0.0], v=motion.v * [1.0, 0.0], a=motion.a * [1.0, 0.0])
    problem = lab.prepared(planar2, (lab.recording(planar2, still, -still.v * 0.15),)).problem
    every = replace(problem, fitted_nuisances=np.arange(problem.nuisance_count))
    assert 0 < len(problem.fitted_nuisances) < problem.nuisance_count
    assert fit(problem, ()).objective == pytest.approx(fit(every, ()).objective, abs=1.0)


def test_the_penalty_counts_squared_sigmas(rough):
    found = fit(rough.problem, ())
    sigma = np.array([n.sigma for n in rough.columns.tolerance_parameters])
    assert found.penalty == pytest.approx(np.sum((found.theta[: len(sigma)] / sigma) ** 2))


def test_predictions_are_what_the_loss_is_made_of(lab, planar2):
    # Unwhitened, so that the loss in sample is the weighted square of measured less predicted torque.
    motion = lab.motion(2, 3)
    recording = lab.recording(planar2, motion, -motion.v * 0.15)
    prepared = lab.prepared(planar2, (recording,), white=False)
    terms = (prepared.term("viscous_friction", "shoulder"), prepared.term("torque_constant", "elbow"))
    found = fit(prepared.problem, terms, held_out=False)
    assert found.loss.size == 0
    torque = predict(prepared.problem, terms, found.theta, 0)
    columns = prepared.columns
    error = (columns.model_torque[0] + columns.residual[0] - torque) * columns.usable[0]
    squared = (error**2).sum(axis=0) @ prepared.weights.per_sample
    nuisances = np.arange(prepared.problem.nuisance_count)
    priors = prepared.problem.precision[nuisances] @ found.theta[nuisances] ** 2
    assert squared + priors == pytest.approx(found.objective, rel=1e-3)


def test_an_empty_fit_predicts_the_given_model_where_it_is_trusted(lab, planar2, trusted):
    robot = trusted(planar2)
    prepared = lab.prepared(robot, (lab.recording(robot, lab.motion(2)),))
    none = np.zeros(len(prepared.columns.names))
    np.testing.assert_array_equal(predict(prepared.problem, (), none, 0), prepared.columns.model_torque[0])


@pytest.mark.parametrize("start", [[0.8, 0.1, -0.2, 0.3], [2.0, 0.0, 0.4, 0.0], [-0.5, 0.1, 0.2, 0.0]])
def test_the_map_of_a_point_mass_is_exact_at_its_start(start):
    start = np.array(start)
    np.testing.assert_allclose(
        point_mass_jacobian(start, np.zeros(6)) @ start, point_mass_parameters(start[0], start[1:] / start[0])
    )


@pytest.mark.parametrize("start", [[0.8, 0.1, -0.2, 0.3], [2.0, 0.0, 0.4, 0.0]])
def test_the_slope_of_a_point_mass_is_that_of_finite_differences(start):
    start, step = np.array(start), 1e-6
    jacobian = point_mass_jacobian(start, np.zeros(6))
    for k, unit in enumerate(np.eye(4)):
        more, less = start + step * unit, start - step * unit
        slope = point_mass_parameters(more[0], more[1:] / more[0]) - point_mass_parameters(less[0], less[1:] / less[0])
        np.testing.assert_allclose(jacobian[:, k], slope / (2 * step), atol=1e-6)


def test_a_point_mass_without_mass_has_no_inertia():
    np.testing.assert_array_equal(
        point_mass_jacobian(np.zeros(4), np.zeros(6)), np.vstack([np.eye(4), np.zeros((6, 4))])
    )


@pytest.mark.parametrize(
    ("mass", "center"),
    [(-0.3, (0.0, 0.0, -0.3)), (0.6, (0.05, 0.0, -0.35)), (0.2, (0.0, 0.0, -0.9)), (2.5, (0.1, 0.0, -0.1))],
)
def test_a_known_payload_comes_back(lab, planar2, trusted, mass, center):
    robot = trusted(planar2)
    motion = lab.motion(2, 4)
    theta = np.array([mass, *center])
    torque = lab.acting(robot, motion, "payload", None, *theta)
    prepared = lab.prepared(robot, (lab.recording(robot, motion, torque, noise=0.01),))
    term = prepared.term("payload", None)
    found = fit(prepared.problem, (term,))
    got = term.effect.from_coefficients(robot, None, found.theta[list(term.columns)], ())
    # The arm is planar: the centre along the hinges leaves no trace.
    np.testing.assert_allclose(got[[0, 1, 3]], theta[[0, 1, 3]], atol=0.03 * max(mass, 0.3))


@pytest.mark.parametrize("ratio", [0.6, 0.9, 1.25, 1.6])
def test_a_known_torque_constant_comes_back(lab, planar2, trusted, ratio):
    # Known truth with other effects beside it: friction is multiplied by the wrong constant too.
    robot = trusted(planar2)
    motion = lab.motion(2, 5)
    friction = -np.sign(motion.v) * [0.0, 0.3]
    needed = inverse_dynamics(robot, motion) - friction
    logged = needed / [ratio, 1.0]
    recording = replace(lab.recording(robot, motion, 0.0, noise=0.0), tau=logged)
    prepared = lab.prepared(robot, (recording,))
    terms = (prepared.term("torque_constant", "shoulder"), prepared.term("coulomb_friction", "elbow"))
    found = fit(prepared.problem, terms)
    got = terms[0].effect.from_coefficients(robot, "shoulder", found.theta[list(terms[0].columns)], ())
    assert got[0] == pytest.approx(ratio, rel=2e-3)


@pytest.mark.parametrize("ratio", [0.6, 1.6])
def test_friction_behind_a_wrong_torque_constant_comes_back_in_true_torque(lab, planar2, trusted, ratio):
    # A fit that is linear in both would give ratio times less friction than there is.
    robot = trusted(planar2)
    motion = lab.motion(2, 5)
    needed = inverse_dynamics(robot, motion) + 0.3 * np.sign(motion.v) * [1.0, 0.0]
    recording = replace(lab.recording(robot, motion, 0.0, noise=0.0), tau=needed / [ratio, 1.0])
    prepared = lab.prepared(robot, (recording,))
    terms = (prepared.term("torque_constant", "shoulder"), prepared.term("coulomb_friction", "shoulder"))
    found = fit(prepared.problem, terms)
    assert 1 / (1 + found.theta[terms[0].columns[0]]) == pytest.approx(ratio, rel=5e-3)
    assert found.theta[terms[1].columns[0]] == pytest.approx(0.3, rel=0.02)


def test_held_out_losses_of_a_wrong_torque_constant_are_those_of_its_predictions(lab, planar2):
    # The gain multiplies everything else on its row, also in fits that have not seen a fold.
    motion = lab.motion(2, 5)
    robot = replace(planar2, tolerance=Tolerance(0.0, 0.0, 0.0))
    needed = inverse_dynamics(robot, motion)
    recording = replace(lab.recording(robot, motion, 0.0, noise=0.05), tau=needed / [1.3, 1.0])
    prepared = lab.prepared(robot, (recording,), white=False)
    terms = (prepared.term("torque_constant", "shoulder"),)
    found = fit(prepared.problem, terms)
    columns = prepared.columns
    for k in (0, 4):
        block = prepared.blocks[k]
        part = slice(block.core, block.stop)
        torque = predict(prepared.problem, terms, found.fold_theta[prepared.folds[k]], 0)
        error = (columns.model_torque[0] + columns.residual[0] - torque)[part] * columns.usable[0][part]
        expected = (error**2).sum(axis=0) @ prepared.weights.per_sample
        assert found.loss[k] == pytest.approx(expected, rel=2e-2)


@pytest.mark.parametrize("mass", [0.05, 0.4, 1.0])
def test_a_load_far_out_is_found_where_its_inertia_outweighs_its_moment(lab, pendulum, mass):
    # Known truth: a point mass at 1.2 m, beyond the distances that are tried without looking at its inertia.
    motion = lab.motion(1, 1)
    torque = lab.acting(pendulum, motion, "payload", None, mass, 0.0, 0.0, -1.2)
    prepared = lab.prepared(pendulum, (lab.recording(pendulum, motion, torque, noise=0.02),))
    term = prepared.term("payload", None)
    found = fit(prepared.problem, (term,)).theta[list(term.columns)]
    assert found[0] == pytest.approx(mass, rel=0.05)
    assert found[3] / found[0] == pytest.approx(-1.2, rel=0.03)


@pytest.mark.parametrize(("size", "held"), [(1e-12, True), (1e-6, False)])
def test_what_a_motion_shows_by_rounding_alone_is_held_at_zero(quiet, size, held):
    # By hand: the third column of a payload is that of the second, much smaller.
    problem, payload = quiet.problem, quiet.term("payload", None)
    white = problem.white
    values = [[rows.copy() for rows in log] for log in white.values]
    for log in values:
        for row, index in zip(log, white.rows, strict=True):
            place = {column: k for k, column in enumerate(index)}
            if payload.columns[3] in place:
                row[:, place[payload.columns[3]]] = size * row[:, place[payload.columns[1]]]
    small = replace(white, values=tuple(tuple(log) for log in values))
    found = set_up(problem.session, problem.columns, small, problem.weights)
    energy = np.diag(found.grams.everything)[payload.columns[3]]
    assert 0.0 < energy < 1e-5 * np.diag(found.grams.everything)[payload.columns[1]]
    assert (found.precision[payload.columns[3]] == 1.0) == held


def test_a_residual_of_the_size_of_the_noise_has_loss_one():
    # Contract: mean over joints of mean square over squared noise floor.
    floor = np.array([0.1, 2.0])
    counts = np.array([[50.0, 40.0], [30.0, 20.0]])
    given = ResidualSums(counts * floor**2, counts)
    assert given.loss(floor, np.ones((1, 2)))[0] == pytest.approx(1.0)
    np.testing.assert_allclose(given.rms(), floor)


def test_the_loss_is_the_mean_over_joints():
    given = ResidualSums(np.array([[100 * 0.09, 50 * 16.0]]), np.array([[100.0, 50.0]]))
    # Joint 1: rms 0.3 over 0.1; joint 2: rms 4 over 2.
    assert given.loss(np.array([0.1, 2.0]), np.ones((1, 1)))[0] == pytest.approx((9 + 4) / 2)


def test_a_block_drawn_twice_counts_twice():
    given = ResidualSums(np.array([[1.0], [9.0]]), np.array([[1.0], [1.0]]))
    loss = given.loss(np.ones(1), np.array([[1.0, 1.0], [2.0, 0.0], [1.0, 3.0]]))
    np.testing.assert_allclose(loss, [5.0, 1.0, 7.0])


@pytest.fixture(scope="module")
def two(lab, planar2):
    recordings = (lab.recording(planar2, lab.motion(2, 1)), lab.recording(planar2, lab.motion(2, 2), seed=1))
    return lab.prepared(planar2, recordings, held_out=1)


def test_held_out_recordings_are_judged_alone(two, quiet):
    assert {two.blocks[k].log for k in judged_blocks(two.problem)} == {1}
    assert len(judged_blocks(quiet.problem)) == len(quiet.blocks)


def test_sums_are_those_of_usable_samples_of_cores(two):
    # Brute force over the judged blocks.
    found = residual_sums(two.problem, two.columns.residual)
    judged = [block for block in two.blocks if block.log == 1]
    for i, block in enumerate(judged):
        use = two.columns.usable[1][block.core : block.stop]
        np.testing.assert_array_equal(found.counts[i], use.sum(axis=0))
        squares = two.columns.residual[1][block.core : block.stop] ** 2
        np.testing.assert_allclose(found.squares[i], (squares * use).sum(axis=0))


def test_a_block_without_a_sample_is_no_block_to_draw(quiet):
    # By hand: a replicate of such blocks alone would have neither squares nor samples.
    usable = quiet.columns.usable[0].copy()
    usable[quiet.blocks[0].start : quiet.blocks[0].stop] = False
    problem = replace(quiet.problem, columns=replace(quiet.columns, usable=(usable,)))
    assert len(residual_sums(problem, quiet.columns.residual).counts) == len(quiet.blocks) - 1


def test_a_sample_counts_as_little_as_the_friction_of_a_standing_joint_is_known_there(two):
    # By hand: where friction is open by twice the noise, a sample counts a fifth.
    twice = tuple(np.full(r.shape, 2.0) * two.problem.weights.floor for r in two.columns.residual)
    standing = replace(two.problem, columns=replace(two.columns, standstill_std=twice))
    moving = replace(two.problem, columns=replace(two.columns, standstill_std=tuple(0.0 * part for part in twice)))
    few, all_ = (residual_sums(problem, two.columns.residual) for problem in (standing, moving))
    np.testing.assert_allclose(few.counts, 0.2 * all_.counts)
    np.testing.assert_allclose(few.squares, 0.2 * all_.squares)
    np.testing.assert_allclose(few.rms(), all_.rms())


def test_each_block_is_predicted_by_the_fit_without_its_fold(two):
    term = two.term("viscous_friction", "elbow")
    found = two.search.held_out_fit(frozenset([term]))
    torque = held_out_torque(two.problem, frozenset([term]), found)
    for block, fold in zip(two.blocks, two.folds, strict=True):
        theta = found.theta if fold < 0 else found.fold_theta[fold]
        part = slice(block.start, block.stop)
        expected = predict(two.problem, (term,), theta, block.log)[part]
        # The product of a part of the rows rounds in its last digit as it likes.
        np.testing.assert_allclose(torque[block.log][part], expected, rtol=1e-12)


def test_what_is_left_is_measured_less_predicted(two):
    columns = two.columns
    measured = tuple(m + r for m, r in zip(columns.model_torque, columns.residual, strict=True))
    rest = residual_after(two.problem, tuple(0.9 * m for m in measured))
    np.testing.assert_allclose(rest[1], 0.1 * measured[1], atol=1e-9)


def test_the_judged_band_leaves_what_lies_above_out(quiet):
    log = quiet.logs[0]
    t = log.motion.t[log.samples]
    slow, fast = np.sin(2 * np.pi * 0.3 * t), np.sin(2 * np.pi * 0.8 * log.band.cutoff_hz * t)
    series = np.column_stack([slow, slow + fast])
    inside = slice(len(t) // 5, -len(t) // 5)
    narrow = replace(quiet.session, cutoff_hz=0.3 * log.band.cutoff_hz).in_judged_band((series,))[0]
    np.testing.assert_allclose(narrow[inside, 1], slow[inside], atol=0.02)


def test_what_ends_above_the_judged_band_is_there_what_it_was(quiet):
    # Closed form: beside a filter of gain 1 / (1 + (f/c)^8) one that ends half as high again changes it by 2.5 %.
    log = quiet.logs[0]
    edge = 0.2 * log.band.cutoff_hz
    session = replace(quiet.session, cutoff_hz=edge)
    t = np.arange(len(log.samples)) / log.band.output_rate_hz
    for share in (0.5, 0.8, 0.9, 1.0, 1.1):
        series = np.sin(2.0 * np.pi * share * edge * t)[:, None]
        once = session.log_in_judged_band(series, 0)
        with_more = session.log_in_judged_band(session.log_below(series, 0, 1.5 * edge), 0)
        inside = slice(len(t) // 4, -len(t) // 4)
        assert np.abs(with_more - once)[inside].max() < 0.026


def test_a_band_that_is_judged_as_it_stands_is_not_filtered_again(quiet):
    series = (quiet.columns.residual[0],)
    same = replace(quiet.session, cutoff_hz=quiet.logs[0].band.cutoff_hz).in_judged_band(series)
    assert same[0] is series[0]
