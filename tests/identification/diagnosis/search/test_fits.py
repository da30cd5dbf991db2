"""Fits of sets of effects: each against the same fit made in another way, or by itself."""

import numpy as np
import pytest

from identification.diagnosis.columns.terms import FoundEffect
from identification.diagnosis.fit.fitting import fit
from identification.diagnosis.fit.gap import held_out_torque
from identification.diagnosis.judge.judged_band import narrow_search
from identification.diagnosis.search import fits
from identification.diagnosis.search.fits import Fits
from identification.engine.fits.bilinear import products_of
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.support.changed_robot import with_gravity

SETS = (
    (("coulomb_friction", "elbow"),),
    (("coulomb_friction", "elbow"), ("viscous_friction", "shoulder")),
    (("coulomb_friction", "elbow"), ("torque_constant", "shoulder")),
)

LOAD, TILT = ("payload", None), ("base_tilt", None)


@pytest.fixture(scope="module")
def rough(lab, planar2):
    """An arm within its tolerances with friction on both joints that its model lacks."""
    motion = lab.motion(2, 3)
    torque = -np.sign(motion.v) * [0.0, 0.25] - motion.v * [0.15, 0.0]
    return lab.prepared(planar2, (lab.recording(planar2, motion, torque),))


@pytest.mark.parametrize("places", SETS)
def test_losses_and_gains_do_not_depend_on_how_many_moves_there_are(rough, places, monkeypatch):
    chosen = frozenset(rough.term(*place) for place in places)
    each, near = Fits(rough.problem), Fits(rough.problem)
    assert each._near is None
    monkeypatch.setattr(fits, "_MANY_MOVES", 1)
    assert near._near is not None
    np.testing.assert_allclose(near.held_out(chosen).loss, each.held_out(chosen).loss, rtol=1e-7)
    assert near.in_sample(chosen) == pytest.approx(each.in_sample(chosen), rel=1e-8)
    expected = each.gains(chosen, rough.problem.columns.terms)
    largest = max(expected.values())
    for term, gain in near.gains(chosen, rough.problem.columns.terms).items():
        assert gain == pytest.approx(expected[term], rel=1e-4, abs=1e-6 * largest)


@pytest.mark.parametrize("places", SETS)
def test_what_a_set_leaves_of_each_row_is_the_same_with_and_without_fits_that_hold_out(rough, places):
    chosen = frozenset(rough.term(*place) for place in places)
    alone, both = Fits(rough.problem), Fits(rough.problem)
    np.testing.assert_allclose(alone.row_losses(chosen), both.held_out(chosen).row_losses, rtol=1e-9)


@pytest.mark.parametrize("places", SETS)
def test_a_fit_does_not_depend_on_the_fits_before_it(rough, places):
    chosen = frozenset(rough.term(*place) for place in places)
    alone, later = Fits(rough.problem), Fits(rough.problem)
    for term in rough.problem.columns.terms:
        later.in_sample(frozenset({term}))
    assert later.in_sample(chosen) == pytest.approx(alone.in_sample(chosen), rel=1e-9)
    np.testing.assert_allclose(later.held_out(chosen).loss, alone.held_out(chosen).loss, rtol=1e-7)


def test_coefficients_of_a_subset_are_those_of_its_held_out_fit(rough):
    places = (("coulomb_friction", "elbow"), ("viscous_friction", "shoulder"), ("rotor_inertia", "elbow"))
    terms = frozenset(rough.term(*place) for place in places)
    fits = Fits(rough.problem)
    solved = fits.of_subsets(terms)
    for left_out in terms:
        found = fits.held_out(terms - {left_out})
        expected = np.vstack([found.fold_theta, found.theta])
        np.testing.assert_allclose(solved(terms - {left_out}), expected, rtol=1e-12, atol=1e-15)


def test_a_payload_without_the_tilt_weighs_in_the_gravity_of_the_model(lab, pendulum, trusted):
    # Closed form: where gravity points along the axis a mass has no moment about it. With a tilt it has one, which
    # looks like what a hardening spring lacks.
    upright = trusted(with_gravity(pendulum, np.array([0.0, -9.81, 0.0])))
    motion = lab.motion(1, 3)
    tilt = FoundEffect(effect_named("base_tilt"), None, (0.0, 0.6), np.array([0.0, 0.6]))
    recording = lab.recording(upright, motion, -2.0 * motion.q**3)
    prepared = lab.prepared(upright, (recording,), found=(tilt,))
    plain = narrow_search(prepared.search, prepared.noise)
    alone, both = (frozenset(prepared.term(*one) for one in places) for places in ((LOAD,), (LOAD, TILT)))
    moments = list(prepared.term(*LOAD).columns[1:4])
    for chosen, weighs in ((both, True), (alone, False)):
        found = plain.evaluate(chosen)
        assert (np.abs(found.problem.total_a[moments][:, moments]).max() > 1e-6) == weighs
    # Its inertia about the axis is all that is left of it, and that makes no spring.
    given, after = (held_out_torque(plain.problem, some, plain.evaluate(some)) for some in (frozenset(), alone))
    left = [np.std(prepared.columns.residual[0] + prepared.columns.model_torque[0] - one[0]) for one in (given, after)]
    assert left[1] > 0.95 * left[0]


def test_what_a_torque_scale_leaves_of_each_row_adds_up_to_what_it_leaves(rough):
    # Oracle: products of the rows rescaled by the gain, by which the fit is made.
    terms = tuple(rough.term(*place) for place in (("coulomb_friction", "elbow"), ("torque_constant", "elbow")))
    found = fit(rough.problem, terms)
    assert found.theta[terms[1].columns[0]] != 0.0
    products = products_of(rough.problem, found.active, found.point.scalings, held_out=True)
    assert products.held_out is not None
    beyond = found.theta[found.active].copy()
    for scaling in found.point.scalings:
        beyond[np.searchsorted(found.active, scaling.column)] -= scaling.gain - 1.0
    left = products.held_out.losses(np.tile(beyond, (len(found.loss), 1)))
    assert found.row_losses.sum() == pytest.approx(left.sum(), rel=1e-5)
