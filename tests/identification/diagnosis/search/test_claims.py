"""When a gain is claimed: above chance, on enough blocks, and a fair part of the gap. Oracles: closed forms."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from identification.diagnosis.fit.fitting import Fitted
from identification.diagnosis.search import claims as claims_module
from identification.diagnosis.search.claims import claimed, energy_by_block, least_gain
from identification.diagnosis.search.search import RowGaps


@dataclass(frozen=True)
class Given:
    """Fits that are given: one of the empty set, one of any other."""

    plain: Fitted
    rich: Fitted

    def held_out(self, chosen: frozenset) -> Fitted:
        return self.rich if chosen else self.plain


def given(quiet, loss: np.ndarray, in_sample: float) -> tuple:
    """A search in which a torque offset has this held-out loss and this gain in sample, and the effect."""
    chosen, plain = frozenset([quiet.term("torque_offset", "elbow")]), quiet.search.evaluate(frozenset())
    rich = replace(
        quiet.search.evaluate(chosen), loss=loss, penalty=plain.penalty, objective=plain.objective - in_sample
    )
    return replace(quiet.search, fits=Given(plain, rich)), chosen


@pytest.mark.parametrize(("gains", "claims"), [([40.0, 40.0], False), ([40.0, 40.0, 15.0], True), ([150.0], True)])
def test_a_gain_of_few_blocks_is_claimed_if_it_is_enough_without_the_best_two_or_very_large(quiet, gains, claims):
    # Closed form: a threshold of ten; all other blocks gain nothing, so two standard errors are more than the gain.
    plain = quiet.search.evaluate(frozenset())
    loss = plain.loss.copy()
    loss[: len(gains)] -= gains
    search, chosen = given(quiet, loss, sum(gains))
    assert claimed(search, chosen, frozenset()) is claims


@pytest.mark.parametrize(
    ("held_out", "in_sample", "claims"),
    [(11.0, 11.0, True), (11.0, 9.0, False), (9.0, 11.0, False), (11.0, -50.0, False), (300.0, 9.0, False)],
)
def test_a_gain_is_claimed_only_if_it_is_above_the_threshold_on_held_out_data_and_in_sample(
    quiet, held_out, in_sample, claims
):
    # Closed form: a threshold of ten, and a gain that is the same in every block.
    loss = quiet.search.evaluate(frozenset()).loss
    search, chosen = given(quiet, loss - held_out / len(loss), in_sample)
    assert claimed(search, chosen, frozenset()) is claims


@pytest.mark.parametrize(
    ("by_row", "least"), [([0.0, 1.0], 10.0), ([1.0, 0.0], 100.0), ([1.0, 1.0], 20.0), ([20.0, 1.0], 105.0)]
)
def test_a_gain_counts_on_joints_where_it_closes_a_hundredth_of_the_gap(quiet, by_row, least):
    # By hand: chance gives 10; fair parts are 100 on the first joint and 1 on the second. In the third case 20 are 10
    # on the second joint, in the last 105 are 100 on the first.
    search = replace(quiet.search, rows=RowGaps(np.array([1e4, 1e2]), np.zeros(2)))
    one = frozenset([quiet.term("base_tilt", None)])
    assert least_gain(search, one, frozenset(), np.array(by_row)) == pytest.approx(least)


@pytest.mark.parametrize(("beside", "least"), [("torque_offset", 10.0), ("coulomb_friction", 100.0)])
def test_what_an_exact_law_has_closed_is_no_gap_that_the_next_claim_has_to_close_a_part_of(lab, planar2, beside, least):
    # By hand: the offset is all of the gap, and is taken off to the noise; what friction leaves may be of its own
    # making.
    motion = lab.motion(2)
    torque = lab.acting(planar2, motion, "torque_offset", "elbow", 2.0)
    made = lab.prepared(planar2, (lab.recording(planar2, motion, torque),))
    search = replace(made.search, rows=RowGaps(np.array([1e4, 1e4]), np.zeros(2)))
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
    plain = quiet.search.evaluate(frozenset())
    energy, loss = np.zeros(len(plain.loss)), plain.loss.copy()
    for block, share in acting.items():
        energy[block] = share
    for block, gain in gains.items():
        loss[block] -= gain
    monkeypatch.setattr(claims_module, "energy_by_block", lambda problem, terms: energy)
    search, chosen = given(quiet, loss, 20.0)
    assert claimed(search, chosen, frozenset()) is claims


def test_the_energy_by_block_is_that_of_the_columns_in_the_cores(quiet):
    # Brute force over samples, of white columns.
    term, problem = quiet.term("coulomb_friction", "elbow"), quiet.problem
    values = problem.white.values[0][1][:, problem.columns.rows[1].index(term.columns[0])]
    use = problem.white.usable[0][:, 1]
    squares = np.array([(values[b.core : b.stop][use[b.core : b.stop]] ** 2).sum() for b in problem.blocks])
    np.testing.assert_allclose(energy_by_block(problem, frozenset([term])), squares / squares.max(), rtol=1e-9)
