"""Fits of sets of effects: each against the same fit made in another way, or by itself.

When a gain is claimed: above chance, on enough blocks, and a fair part of the gap. Oracles: closed forms.

What is written down of decisions. Oracle: by hand.

What subsets of effects leave, from summed products. Oracle: the residual itself, sample by sample.
"""

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
import pytest

from identification.diagnosis.columns.terms import FoundEffect, Term
from identification.diagnosis.fit.fitting import Fitted, fit
from identification.diagnosis.fit.gap import held_out_torque
from identification.diagnosis.judge.judged_band import plain_search
from identification.diagnosis.judge.shares import residual_sums_with
from identification.diagnosis.search import claims as claims_module
from identification.diagnosis.search import fits
from identification.diagnosis.search.claims import energy_by_block, least_gain, passes_gates
from identification.diagnosis.search.fits import FitLimitReached, Fits
from identification.diagnosis.search.record import Record
from identification.diagnosis.search.search import RowGaps
from identification.diagnosis.search.subset_residuals import subset_residuals
from identification.engine.claims import GateResult
from identification.engine.fits.bilinear import products_of
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.support.changed_robot import with_gravity

SETS = (
    (("coulomb_friction", "elbow"),),
    (("coulomb_friction", "elbow"), ("viscous_friction", "shoulder")),
    (("coulomb_friction", "elbow"), ("torque_constant", "shoulder")),
)

LOAD, TILT = ("payload", None), ("base_tilt", None)


def test_a_limit_of_fits_counts_those_at_the_positions_as_read_and_ends_with_the_search(rough, monkeypatch):
    # By hand: two fits may be made, one of each problem.
    load, rub = (frozenset([rough.term(*place)]) for place in (LOAD, ("coulomb_friction", "elbow")))
    read = replace(rough.problem)
    both = replace(rough.problem, at_readings=read)
    monkeypatch.setattr(type(both), "of", lambda self, chosen: read if chosen == load and self is both else self)
    limited = Fits(both, iter(range(2)))
    for chosen in (rub, load):
        limited.held_out(chosen)
    for chosen in (rub | load, frozenset[Term]()):
        with pytest.raises(FitLimitReached):
            limited.held_out(chosen)
    limited.without_limit()
    assert limited.of(load) is not limited
    assert limited.held_out(rub | load).total == Fits(rough.problem).held_out(rub | load).total
    limited._at_readings._held_out.clear()
    assert limited.held_out(load).total == Fits(rough.problem).held_out(load).total


@pytest.mark.parametrize("places", SETS)
def test_losses_and_gains_do_not_depend_on_how_many_nuisances_there_are(rough, places, monkeypatch):
    chosen = frozenset(rough.term(*place) for place in places)
    each, near = Fits(rough.problem), Fits(rough.problem)
    assert each._similar_fits is None
    monkeypatch.setattr(fits, "_MANY_NUISANCES", 1)
    assert near._similar_fits is not None
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


def test_a_subset_is_fitted_to_the_problem_that_it_needs(rough, monkeypatch):
    # Oracle: the fit to the other problem, in which the tolerances are a tenth as wide.
    rub, viscous = rough.term("coulomb_friction", "elbow"), rough.term("viscous_friction", "shoulder")
    read = replace(rough.problem, precision=100.0 * rough.problem.precision)
    both = replace(rough.problem, at_readings=read)
    monkeypatch.setattr(type(both), "of", lambda self, chosen: self if viscous in chosen or self is read else read)
    monkeypatch.setattr(fits, "_MANY_NUISANCES", 1)
    solved = Fits(both).of_subsets(frozenset([rub, viscous]))(frozenset([rub]))
    expected = Fits(read).held_out(frozenset([rub]))
    np.testing.assert_allclose(solved, np.vstack([expected.fold_theta, expected.theta]), rtol=1e-6, atol=1e-9)


def test_a_payload_without_the_tilt_weighs_in_the_gravity_of_the_model(lab, pendulum, trusted):
    # Closed form: where gravity points along the axis a mass has no moment about it. With a tilt it has one, which
    # looks like what a hardening spring lacks.
    upright = trusted(with_gravity(pendulum, np.array([0.0, -9.81, 0.0])))
    motion = lab.motion(1, 3)
    tilt = FoundEffect(effect_named("base_tilt"), None, (0.0, 0.6), np.array([0.0, 0.6]))
    recording = lab.recording(upright, motion, -2.0 * motion.q**3)
    prepared = lab.prepared(upright, (recording,), found=(tilt,))
    plain = plain_search(prepared.search, prepared.noise)
    alone, both = (frozenset(prepared.term(*one) for one in places) for places in ((LOAD,), (LOAD, TILT)))
    moments = list(prepared.term(*LOAD).columns[1:4])
    for chosen, weighs in ((both, True), (alone, False)):
        found = plain.held_out_fit(chosen)
        assert (np.abs(found.problem.total_a[moments][:, moments]).max() > 1e-6) == weighs
    # Its inertia about the axis is all that is left of it, and that makes no spring.
    given, after = (held_out_torque(plain.problem, some, plain.held_out_fit(some)) for some in (frozenset(), alone))
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


@dataclass(frozen=True)
class Given:
    """Fits that are given: one of the empty set, one of any other."""

    plain: Fitted
    rich: Fitted

    def held_out(self, chosen: frozenset) -> Fitted:
        return self.rich if chosen else self.plain


def given(quiet, loss: np.ndarray, in_sample: float) -> tuple:
    """A search in which a torque offset has this held-out loss and this gain in sample, and the effect."""
    chosen, plain = frozenset([quiet.term("torque_offset", "elbow")]), quiet.search.held_out_fit(frozenset())
    rich = replace(
        quiet.search.held_out_fit(chosen), loss=loss, penalty=plain.penalty, objective=plain.objective - in_sample
    )
    return replace(quiet.search, fits=Given(plain, rich)), chosen


@pytest.mark.parametrize(("gains", "claims"), [([40.0, 40.0], False), ([40.0, 40.0, 15.0], True), ([150.0], True)])
def test_a_gain_of_few_blocks_is_claimed_if_it_is_enough_without_the_best_two_or_very_large(quiet, gains, claims):
    # Closed form: a threshold of ten; all other blocks gain nothing, so two standard errors are more than the gain.
    plain = quiet.search.held_out_fit(frozenset())
    loss = plain.loss.copy()
    loss[: len(gains)] -= gains
    search, chosen = given(quiet, loss, sum(gains))
    assert passes_gates(search, chosen, frozenset()) is claims


@pytest.mark.parametrize(
    ("held_out", "in_sample", "claims"),
    [(11.0, 11.0, True), (11.0, 9.0, False), (9.0, 11.0, False), (11.0, -50.0, False), (300.0, 9.0, False)],
)
def test_a_gain_is_claimed_only_if_it_is_above_the_threshold_on_held_out_data_and_in_sample(
    quiet, held_out, in_sample, claims
):
    # Closed form: a threshold of ten, and a gain that is the same in every block.
    loss = quiet.search.held_out_fit(frozenset()).loss
    search, chosen = given(quiet, loss - held_out / len(loss), in_sample)
    assert passes_gates(search, chosen, frozenset()) is claims


@pytest.mark.parametrize(
    ("by_row", "least"), [([0.0, 1.0], 10.0), ([1.0, 0.0], 100.0), ([1.0, 1.0], 20.0), ([20.0, 1.0], 105.0)]
)
def test_a_gain_counts_on_joints_where_it_closes_a_hundredth_of_the_gap(quiet, by_row, least):
    # By hand: chance gives 10; fair parts are 100 on the first joint and 1 on the second. In the third case 20 are 10
    # on the second joint, in the last 105 are 100 on the first.
    search = replace(quiet.search, gaps=RowGaps(np.array([1e4, 1e2]), np.zeros(2)))
    one = frozenset([quiet.term("base_tilt", None)])
    assert least_gain(search, one, frozenset(), np.array(by_row)) == pytest.approx(least)


@pytest.mark.parametrize(("beside", "least"), [("torque_offset", 10.0), ("coulomb_friction", 100.0)])
def test_what_an_exact_law_has_closed_is_no_gap_that_the_next_claim_has_to_close_a_part_of(lab, planar2, beside, least):
    # By hand: the offset is all of the gap, and is taken off to the noise; what friction leaves may be of its own
    # making.
    motion = lab.motion(2)
    torque = lab.acting(planar2, motion, "torque_offset", "elbow", 2.0)
    made = lab.prepared(planar2, (lab.recording(planar2, motion, torque),))
    search = replace(made.search, gaps=RowGaps(np.array([1e4, 1e4]), np.zeros(2)))
    claim, there = (frozenset([made.term(name, "elbow")]) for name in ("viscous_friction", beside))
    assert least_gain(search, claim, there, np.array([0.0, 1.0])) == pytest.approx(least)


@pytest.mark.parametrize(
    ("acting", "gains", "claims"),
    [
        ({3: 1.0, 7: 0.5}, {3: 15.0, 7: 5.0}, True),
        ({3: 1.0, 7: 0.5}, {3: 22.0, 7: -2.0}, False),
        ({3: 1.0, 7: 0.05}, {3: 22.0, 7: -2.0}, True),
        ({3: 1.0, 7: 0.5, 0: 1e-3, 1: 1e-3}, {3: 15.0, 7: 5.0}, False),
    ],
)
def test_an_effect_that_is_zero_in_most_blocks_is_judged_where_it_acts(quiet, monkeypatch, acting, gains, claims):
    # Closed form: a threshold of ten, and a gain of twenty in two blocks, which the two best are not left out of.
    plain = quiet.search.held_out_fit(frozenset())
    energy, loss = np.zeros(len(plain.loss)), plain.loss.copy()
    for block, share in acting.items():
        energy[block] = share
    for block, gain in gains.items():
        loss[block] -= gain
    monkeypatch.setattr(claims_module, "energy_by_block", lambda problem, terms: energy)
    search, chosen = given(quiet, loss, 20.0)
    assert passes_gates(search, chosen, frozenset()) is claims


def test_the_energy_by_block_is_that_of_the_columns_in_the_cores(quiet):
    # Brute force over samples, of white columns.
    term, problem = quiet.term("coulomb_friction", "elbow"), quiet.problem
    values = problem.white.values[0][1][:, problem.columns.rows[1].index(term.columns[0])]
    use = problem.white.usable[0][:, 1]
    squares = np.array([(values[b.core : b.stop][use[b.core : b.stop]] ** 2).sum() for b in problem.blocks])
    np.testing.assert_allclose(energy_by_block(problem, frozenset([term])), squares / squares.max(), rtol=1e-9)


LOW, HIGH = GateResult("gain", 1.0, 2.0, "1", False), GateResult("gain", 3.0, 2.0, "1", True)
LASTING = GateResult("lasting", 5.0, 2.0, "1", True)


def test_the_last_result_of_a_gate_counts(quiet):
    record, term = Record(), quiet.term("coulomb_friction", "elbow")
    record.add_passed([term], HIGH, LASTING)
    record.add_failed([term], LOW)
    assert record.results_of(term.effect_joint) == (LOW, LASTING)


def test_what_comes_back_has_failed_nothing_and_nothing_is_in_its_place(quiet):
    record = Record()
    term, other = quiet.term("coulomb_friction", "elbow"), quiet.term("viscous_friction", "elbow")
    record.add_failed([term], LOW, replaced_by=[other])
    assert record.replacements_of(term.effect_joint) == (other.effect_joint,)
    record.add_passed([term], LASTING)
    assert record.results_of(term.effect_joint) == (LASTING,)
    assert record.replacements_of(term.effect_joint) == ()


def test_a_trial_changes_nothing_before_it_is_taken(quiet):
    record, term = Record(), quiet.term("coulomb_friction", "elbow")
    trial = record.copy_for_trial()
    trial.add_passed([term], HIGH)
    assert record.claimed == ()
    record.take_over(trial)
    assert record.claimed == (term.effect_joint,)


def test_a_structure_without_a_name_is_no_claim(quiet):
    record, nameless = Record(), next(term for term in quiet.search.terms if not term.named)
    record.add_passed([nameless], HIGH)
    assert record.claimed == ()


@pytest.fixture(scope="module")
def planar(lab, planar2):
    """A plain search whose band is the recording's, and effects of which one scales all that is beside it."""
    motion = lab.motion(2, 4, seconds=20.0)
    torque = -0.3 * np.sign(motion.v) * [0.0, 1.0] + np.array([0.4, 0.0])
    prepared = lab.prepared(planar2, (lab.recording(planar2, motion, torque),))
    plain = plain_search(prepared.search, prepared.noise)
    places = [("coulomb_friction", "elbow"), ("torque_offset", "shoulder"), ("torque_constant", "elbow")]
    return plain, frozenset(prepared.term(*place) for place in places)


def test_every_subset_leaves_what_its_residual_says(planar):
    plain, terms = planar
    left = subset_residuals(plain, terms)
    for size in range(len(terms) + 1):
        for some in map(frozenset, combinations(terms, size)):
            expected, found = residual_sums_with(plain, some), left(some)
            np.testing.assert_allclose(found.counts.sum(axis=0), expected.counts.sum(axis=0))
            # The residual is low-passed across the edges of blocks, at which the fit changes.
            np.testing.assert_allclose(found.rms(), expected.rms(), rtol=2e-3)
