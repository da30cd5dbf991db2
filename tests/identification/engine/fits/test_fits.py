"""Fits of the engine."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from identification.diagnosis.fit.fitting import active_columns, fit
from identification.engine.fits import near_fits
from identification.engine.fits.minimum import minimum_of
from identification.engine.fits.near_fits import NearFits
from identification.engine.fits.projection import fold_projections, gains_if_added, project_off_fit
from identification.engine.numerics.bounded import bounded_solve, solve

SAMPLES, COLUMNS, FOLDS = 120, 6, 4


@pytest.fixture
def samples(rng):
    x = rng.normal(size=(SAMPLES, COLUMNS))
    return x, x @ rng.normal(size=COLUMNS) + rng.normal(size=SAMPLES), np.arange(SAMPLES) % FOLDS


PRECISION = np.array([0.0, 0.0, 5.0, 20.0, 1.0, 0.0])

BOUNDS = np.full(COLUMNS, -0.4), np.full(COLUMNS, 0.5)


def by_scipy(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    rows = np.vstack([x, np.diag(np.sqrt(PRECISION))])
    return lsq_linear(rows, np.concatenate([y, np.zeros(COLUMNS)]), BOUNDS, tol=1e-14).x


def found(samples, folds=None):
    x, y, _ = samples
    return minimum_of(x.T @ x, x.T @ y, float(y @ y), PRECISION, BOUNDS, np.full(COLUMNS, np.nan), folds)


def test_coefficients_are_the_least_squares_within_bounds_with_priors(samples):
    x, y, _ = samples
    expected = by_scipy(x, y)
    assert np.any((expected < BOUNDS[0] + 1e-9) | (expected > BOUNDS[1] - 1e-9))
    np.testing.assert_allclose(found(samples).x, expected, atol=1e-6)


def test_the_objective_is_the_squares_that_are_left_and_the_priors(samples):
    x, y, _ = samples
    fit = found(samples)
    assert fit.objective == pytest.approx(np.sum((y - x @ fit.x) ** 2) + np.sum(PRECISION * fit.x**2))


def test_fits_without_a_fold_have_not_seen_it(samples):
    x, y, fold = samples
    parts = [(x[fold == k], y[fold == k]) for k in range(FOLDS)]
    folds = np.array([a.T @ a for a, _ in parts]), np.array([a.T @ b for a, b in parts])
    expected = [by_scipy(x[fold != k], y[fold != k]) for k in range(FOLDS)]
    np.testing.assert_allclose(found(samples, folds).without, expected, atol=1e-6)


def test_nothing_is_held_out_without_folds(samples):
    assert found(samples).without.shape == (0, COLUMNS)


FRICTION = (("coulomb_friction", "elbow"), ("viscous_friction", "shoulder"))

SETS = (
    (),
    FRICTION[:1],
    (*FRICTION, ("rotor_inertia", "elbow")),
    (("torque_offset", "elbow"), ("viscous_friction", "shoulder"), ("parasitic_spring", "shoulder")),
)


@pytest.fixture(scope="module")
def rough(lab, planar2):
    """An arm within its tolerances with friction on both joints and an offset, none of which its model has."""
    motion = lab.motion(2, 3)
    torque = -np.sign(motion.v) * [0.0, 0.25] - motion.v * [0.15, 0.0] + [0.0, 0.1]
    return lab.prepared(planar2, (lab.recording(planar2, motion, torque),))


@pytest.fixture(scope="module")
def near(rough):
    """Fits of which one set, that of the friction, is solved as a whole."""
    problem = rough.problem
    fits = NearFits(problem, np.full(len(problem.precision), np.nan))
    fits.fit(active_columns(problem, terms_of(rough, FRICTION)), held_out=True)
    return fits


def terms_of(rough, places):
    return tuple(rough.term(*place) for place in places)


def test_the_fits_under_test_are_not_solved_as_a_whole(rough, near):
    columns = [active_columns(rough.problem, terms_of(rough, places)) for places in (FRICTION, *SETS)]
    changes = [len(set(columns[0].tolist()) ^ set(some.tolist())) for some in columns[1:]]
    assert 0 not in changes
    assert max(changes) < near_fits._MOST_DIFFERENCES


@pytest.mark.parametrize("places", SETS)
def test_a_fit_is_that_of_the_same_columns_solved_as_a_whole(rough, near, places):
    terms = terms_of(rough, places)
    expected, found = fit(rough.problem, terms), near.fit(active_columns(rough.problem, terms), held_out=True)
    size = np.sqrt(np.diag(rough.problem.total_a) + rough.problem.precision)
    assert found.objective == pytest.approx(expected.objective, rel=1e-8)
    assert found.penalty == pytest.approx(expected.penalty, rel=1e-6)
    np.testing.assert_allclose(found.theta * size, expected.theta * size, atol=1e-5)
    own = size[found.active]
    np.testing.assert_allclose(found.fold_active * own, expected.fold_active * own, atol=1e-5)


@pytest.mark.parametrize("places", SETS)
def test_coefficients_alone_are_those_of_the_fits(rough, near, places):
    active = active_columns(rough.problem, terms_of(rough, places))
    expected, found = near.fit(active, held_out=True), near.coefficients(active)
    size = np.sqrt(np.diag(rough.problem.total_a) + rough.problem.precision)
    np.testing.assert_allclose(found[-1] * size, expected.theta * size, atol=1e-6)
    own = size[active]
    np.testing.assert_allclose(found[:-1, active] * own, expected.fold_active * own, atol=1e-6)


@pytest.mark.parametrize("places", SETS)
def test_each_block_is_judged_by_the_fit_that_has_not_seen_it(rough, near, places):
    terms = terms_of(rough, places)
    found = near.fit(active_columns(rough.problem, terms), held_out=True)
    np.testing.assert_allclose(found.loss, fit(rough.problem, terms).loss, rtol=1e-7)


@pytest.mark.parametrize("places", SETS)
def test_what_columns_gain_beside_a_fit_is_what_a_projection_says(rough, near, places):
    problem, terms = rough.problem, terms_of(rough, places)
    sets = {term.columns for term in problem.columns.terms}
    found = near.gains(active_columns(problem, terms), sets)
    expected = gains_if_added(problem, fit(problem, terms, held_out=False), sets)
    largest = max(expected.values())
    for columns in sets:
        assert found[columns] == pytest.approx(expected[columns], rel=1e-4, abs=1e-6 * largest)


def test_a_set_far_from_all_is_solved_as_a_whole(rough, monkeypatch):
    problem = rough.problem
    fits = NearFits(problem, np.full(len(problem.precision), np.nan))
    monkeypatch.setattr(near_fits, "_MOST_DIFFERENCES", 0)
    for places in SETS:
        terms = terms_of(rough, places)
        found = fits.fit(active_columns(problem, terms), held_out=True)
        np.testing.assert_allclose(found.loss, fit(problem, terms).loss, rtol=1e-7)


def test_a_solved_set_is_as_far_as_the_columns_and_the_bounds_in_which_a_fit_of_a_similar_set_differs(rough):
    problem = rough.problem
    fits = NearFits(problem, np.full(len(problem.precision), np.nan))
    columns = [active_columns(problem, terms_of(rough, places)) for places in (FRICTION, ())]
    for some in columns:
        fits.fit(some, held_out=False)
    # Without the friction that it lacks, the model changes to other bounds.
    ends = [fit(problem, terms_of(rough, places), held_out=False).theta for places in (FRICTION, ())]
    bound = [(theta <= problem.lower) | (theta >= problem.upper) for theta in ends]
    elsewhere = np.count_nonzero((bound[0] != bound[1])[columns[1]])
    assert elsewhere > 0
    wanted = np.isin(np.arange(len(problem.precision)), columns[1])
    (solved,), end = fits._solved, fits._past_fits[-1]
    assert solved.differences(wanted, end) == len(columns[0]) - len(columns[1]) + elsewhere
    assert solved.differences(wanted, None) == len(columns[0]) - len(columns[1])


@pytest.fixture(scope="module")
def rough_columns(lab, planar2, trusted):
    """A trusted arm with friction on both joints and an offset, none of which its model has."""
    robot, motion = trusted(planar2), lab.motion(2, 3)
    torque = -np.sign(motion.v) * [0.0, 0.25] - motion.v * [0.15, 0.0] + [0.0, 0.1]
    return lab.prepared(robot, (lab.recording(robot, motion, torque),))


@pytest.mark.parametrize(
    "rival",
    [
        ("torque_offset", "elbow"),
        ("viscous_friction", "elbow"),
        ("parasitic_spring", "shoulder"),
        ("rotor_inertia", "elbow"),
    ],
)
def test_a_gain_is_the_difference_of_two_fits_where_no_bound_binds(rough_columns, rival):
    chosen, term = (rough_columns.term("coulomb_friction", "elbow"),), rough_columns.term(*rival)
    without, with_it = (fit(rough_columns.problem, terms, held_out=False) for terms in (chosen, (*chosen, term)))
    expected = without.objective - with_it.objective
    gains = gains_if_added(rough_columns.problem, without, [term.columns])
    assert gains[term.columns] == pytest.approx(expected, rel=1e-6, abs=1e-9)


def test_a_gain_stops_at_the_bound_of_the_coefficient(lab, planar2, trusted):
    # Closed form: a delay of a drive that is early is zero, so it gains nothing, whatever a free fit would.
    robot = trusted(planar2)
    early = lab.recording(robot, lab.motion(2, 3), 0.0)
    early = type(early)(early.file, early.joint_names, early.t, early.q, np.roll(early.tau, 3, axis=0))
    prepared = lab.prepared(robot, (early,))
    fitted, term = fit(prepared.problem, (), held_out=False), prepared.term("input_delay", None)
    _, _, gradient = project_off_fit(prepared.problem, fitted, np.array(term.columns))
    assert gradient.item() < 0
    gains = gains_if_added(prepared.problem, fitted, [term.columns])
    assert gains[term.columns] == pytest.approx(0.0, abs=1e-12)


def test_a_rival_whose_columns_are_all_in_the_fit_gains_nothing(rough_columns):
    term = rough_columns.term("coulomb_friction", "elbow")
    assert gains_if_added(
        rough_columns.problem, fit(rough_columns.problem, (term,), held_out=False), [term.columns]
    ) == {term.columns: 0.0}


def test_columns_of_a_fit_have_no_product_with_its_residual(rough_columns):
    # The normal equations of a fit: what is left of the residual is orthogonal to its own columns.
    term = rough_columns.term("coulomb_friction", "elbow")
    fitted, own = fit(rough_columns.problem, (term,), held_out=False), np.array(term.columns)
    _, _, gradient = project_off_fit(rough_columns.problem, fitted, own)
    np.testing.assert_allclose(gradient, 0.0, atol=1e-6 * np.abs(rough_columns.problem.total_b[own]).max())


def test_gains_of_all_rivals_are_those_of_each_alone(rough_columns):
    # The bounded minimum of each rival's own products, made from whole matrices.
    problem, term = rough_columns.problem, rough_columns.term("coulomb_friction", "elbow")
    fitted = fit(problem, (term,), held_out=False)
    gains = gains_if_added(problem, fitted, {rival.columns for rival in problem.columns.terms})
    _, _, gradient = project_off_fit(problem, fitted, np.arange(len(problem.precision)))
    inside, x = frozenset(fitted.active.tolist()), fitted.theta[fitted.active]
    # A nuisance that is at its bound stays there.
    free = fitted.active[np.abs(x - problem.lower[fitted.active]) > 1e-12]
    free = free[np.abs(fitted.theta[free] - problem.upper[free]) > 1e-12]
    inner = problem.total_a[np.ix_(free, free)] + np.diag(problem.precision[free])
    left = problem.total_a - problem.total_a[free].T @ solve(inner, problem.total_a[free]) + np.diag(problem.precision)
    seen = 0
    for rival in problem.columns.terms:
        own = [k for k in rival.columns if k not in inside]
        if len(own) == 2:
            a, b = left[np.ix_(own, own)], gradient[own]
            x = bounded_solve(a, b, problem.lower[own], problem.upper[own])
            assert gains[rival.columns] == pytest.approx(2 * b @ x - x @ a @ x, rel=1e-6, abs=1e-9)
            seen += 1
    assert seen > 5


@pytest.fixture(scope="module")
def sprung(lab, planar2, trusted):
    """A trusted arm with a spring on its elbow: smooth, so that nothing else goes to a bound."""
    robot, motion = trusted(planar2), lab.motion(2, 3)
    return lab.prepared(robot, (lab.recording(robot, motion, -(0.8 * motion.q + 0.1) * [0.0, 1.0]),))


@pytest.mark.parametrize("rival", [("torque_offset", "elbow"), ("parasitic_spring", "elbow")])
@pytest.mark.parametrize("fold", [0, 5])
def test_the_projection_of_a_fold_is_the_fit_without_it(sprung, rival, fold):
    problem, term = sprung.problem, sprung.term(*rival)
    n, own, mine = problem.nuisance_count, list(term.columns), np.flatnonzero(sprung.folds == fold)
    part = fold_projections(problem)[fold]
    right = problem.total_b - problem.grams.b[mine].sum(axis=0)
    held = problem.grams.core_b[mine].sum(axis=0)
    base = solve(part.inner, right[:n])
    group, grams = np.array([own]), problem.grams
    among = problem.total_a[np.ix_(own, own)][None] - grams.fold_a.within(group)[fold]
    x = solve(part.training(group, among)[0], (right - part.coefficients.T @ right[:n])[own])
    explicit, plain = fit(problem, (term,)), fit(problem, ())
    np.testing.assert_allclose(x, explicit.fold_theta[fold][own], rtol=1e-6)
    np.testing.assert_allclose(base, plain.fold_theta[fold][:n], rtol=1e-6)
    inside, across = part.core
    left = held - part.coefficients.T @ held[:n] - (across.T - part.coefficients.T @ inside) @ base
    gain = x @ (2 * left[own] - part.held_out(group, grams.fold_core_a.within(group)[fold])[0] @ x)
    assert gain == pytest.approx(plain.loss[mine].sum() - explicit.loss[mine].sum(), rel=1e-6)


def test_some_columns_are_projected_as_all_are(rough_columns):
    found = fit(rough_columns.problem, (rough_columns.term("coulomb_friction", "elbow"),), held_out=False)
    some = np.array(
        rough_columns.term("viscous_friction", "shoulder").columns
        + rough_columns.term("torque_offset", "elbow").columns
    )
    cross, made, gradient = project_off_fit(rough_columns.problem, found, some)
    all_cross, all_made, all_gradient = project_off_fit(
        rough_columns.problem, found, np.arange(len(rough_columns.problem.precision))
    )
    np.testing.assert_allclose(cross, all_cross[:, some])
    np.testing.assert_allclose(made, all_made[:, some], rtol=1e-9)
    np.testing.assert_allclose(gradient, all_gradient[some], rtol=1e-9)
