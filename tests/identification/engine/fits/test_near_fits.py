"""Fits from the nearest solved set: against fits of the same columns as a whole, which are tested against scipy."""

from __future__ import annotations

import numpy as np
import pytest

from identification.diagnosis.fit.fitting import active_columns, fit
from identification.engine.fits import near_fits
from identification.engine.fits.near_fits import NearFits
from identification.engine.fits.projection import gains_beside

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
    assert max(changes) < near_fits._FAR


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
    expected = gains_beside(problem, fit(problem, terms, held_out=False), sets)
    largest = max(expected.values())
    for columns in sets:
        assert found[columns] == pytest.approx(expected[columns], rel=1e-4, abs=1e-6 * largest)


def test_a_set_far_from_all_is_solved_as_a_whole(rough, monkeypatch):
    problem = rough.problem
    fits = NearFits(problem, np.full(len(problem.precision), np.nan))
    monkeypatch.setattr(near_fits, "_FAR", 0)
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
    # Without the friction that it lacks, the model moves to other bounds.
    ends = [fit(problem, terms_of(rough, places), held_out=False).theta for places in (FRICTION, ())]
    bound = [(theta <= problem.lower) | (theta >= problem.upper) for theta in ends]
    elsewhere = np.count_nonzero((bound[0] != bound[1])[columns[1]])
    assert elsewhere > 0
    wanted = np.isin(np.arange(len(problem.precision)), columns[1])
    (solved,), end = fits._solved, fits._ends[-1]
    assert solved.apart(wanted, end) == len(columns[0]) - len(columns[1]) + elsewhere
    assert solved.apart(wanted, None) == len(columns[0]) - len(columns[1])
