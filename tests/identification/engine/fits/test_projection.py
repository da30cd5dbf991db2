"""What rivals gain beside a fit, by projection: against fits of the same columns, which are tested against scipy."""

from __future__ import annotations

import numpy as np
import pytest

from identification.diagnosis.fit.fitting import fit
from identification.engine.fits.projection import fold_projections, gains_beside, taken_out
from identification.engine.numerics.bounded import bounded_solve, solve


@pytest.fixture(scope="module")
def rough(lab, planar2, trusted):
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
def test_a_gain_is_the_difference_of_two_fits_where_no_bound_binds(rough, rival):
    chosen, term = (rough.term("coulomb_friction", "elbow"),), rough.term(*rival)
    without, with_it = (fit(rough.problem, terms, held_out=False) for terms in (chosen, (*chosen, term)))
    expected = without.objective - with_it.objective
    gains = gains_beside(rough.problem, without, [term.columns])
    assert gains[term.columns] == pytest.approx(expected, rel=1e-6, abs=1e-9)


def test_a_gain_stops_at_the_bound_of_the_coefficient(lab, planar2, trusted):
    # Closed form: a delay of a drive that is early is zero, so it gains nothing, whatever a free fit would.
    robot = trusted(planar2)
    early = lab.recording(robot, lab.motion(2, 3), 0.0)
    early = type(early)(early.file, early.joint_names, early.t, early.q, np.roll(early.tau, 3, axis=0))
    prepared = lab.prepared(robot, (early,))
    fitted, term = fit(prepared.problem, (), held_out=False), prepared.term("input_delay", None)
    _, _, gradient = taken_out(prepared.problem, fitted, np.array(term.columns))
    assert gradient.item() < 0
    gains = gains_beside(prepared.problem, fitted, [term.columns])
    assert gains[term.columns] == pytest.approx(0.0, abs=1e-12)


def test_a_rival_whose_columns_are_all_in_the_fit_gains_nothing(rough):
    term = rough.term("coulomb_friction", "elbow")
    assert gains_beside(rough.problem, fit(rough.problem, (term,), held_out=False), [term.columns]) == {
        term.columns: 0.0
    }


def test_what_a_fit_has_used_is_taken_out_of_all_columns(rough):
    # The normal equations of a fit: what is left of the residual is orthogonal to its own columns.
    term = rough.term("coulomb_friction", "elbow")
    fitted, own = fit(rough.problem, (term,), held_out=False), np.array(term.columns)
    _, _, gradient = taken_out(rough.problem, fitted, own)
    np.testing.assert_allclose(gradient, 0.0, atol=1e-6 * np.abs(rough.problem.total_b[own]).max())


def test_gains_of_all_rivals_are_those_of_each_alone(rough):
    # The bounded minimum of each rival's own products, made from whole matrices.
    problem, term = rough.problem, rough.term("coulomb_friction", "elbow")
    fitted = fit(problem, (term,), held_out=False)
    gains = gains_beside(problem, fitted, {rival.columns for rival in problem.columns.terms})
    _, _, gradient = taken_out(problem, fitted, np.arange(len(problem.precision)))
    inside, x = frozenset(fitted.active.tolist()), fitted.theta[fitted.active]
    # A move that stands at its bound stays there.
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
    n, own, mine = problem.nuisances, list(term.columns), np.flatnonzero(sprung.folds == fold)
    part = fold_projections(problem)[fold]
    right = problem.total_b - problem.grams.b[mine].sum(axis=0)
    held = problem.grams.core_b[mine].sum(axis=0)
    base = solve(part.inner, right[:n])
    group, grams = np.array([own]), problem.grams
    among = problem.total_a[np.ix_(own, own)][None] - grams.fold_a.within(group)[fold]
    x = solve(part.training(group, among)[0], (right - part.made.T @ right[:n])[own])
    explicit, plain = fit(problem, (term,)), fit(problem, ())
    np.testing.assert_allclose(x, explicit.fold_theta[fold][own], rtol=1e-6)
    np.testing.assert_allclose(base, plain.fold_theta[fold][:n], rtol=1e-6)
    inside, across = part.core
    left = held - part.made.T @ held[:n] - (across.T - part.made.T @ inside) @ base
    gain = x @ (2 * left[own] - part.held_out(group, grams.fold_core_a.within(group)[fold])[0] @ x)
    assert gain == pytest.approx(plain.loss[mine].sum() - explicit.loss[mine].sum(), rel=1e-6)


def test_some_columns_are_taken_out_as_all_are(rough):
    found = fit(rough.problem, (rough.term("coulomb_friction", "elbow"),), held_out=False)
    some = np.array(rough.term("viscous_friction", "shoulder").columns + rough.term("torque_offset", "elbow").columns)
    cross, made, gradient = taken_out(rough.problem, found, some)
    all_cross, all_made, all_gradient = taken_out(rough.problem, found, np.arange(len(rough.problem.precision)))
    np.testing.assert_allclose(cross, all_cross[:, some])
    np.testing.assert_allclose(made, all_made[:, some], rtol=1e-9)
    np.testing.assert_allclose(gradient, all_gradient[some], rtol=1e-9)
