"""The ledger of a diagnosis: which gates each candidate effect passed or failed, and which effects displaced it.

It lists all effects that search or judge claimed at any time, and the ten best of the others. Search and judge record
their decisions as they make them. This module tests each other effect once more in addition to the final set: its gain,
the share of the gap that it closes alone, and the findings that explain that share instead.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from identification.diagnosis.columns.terms import Term, ordered
from identification.diagnosis.fit.gap import ResidualSums
from identification.diagnosis.judge.coarse_encoders import CoarseRounding
from identification.diagnosis.judge.findings.gate_state import ShownEffects
from identification.diagnosis.judge.judged_band import JudgedBand
from identification.diagnosis.judge.shares import gap_of
from identification.diagnosis.result import EffectAt
from identification.diagnosis.search.claims import gate_results
from identification.diagnosis.search.containment import can_join, with_term
from identification.diagnosis.search.record import EffectJoint
from identification.diagnosis.search.search import Search, price
from identification.diagnosis.search.subset_residuals import subset_residuals
from identification.diagnosis.search.swaps import with_replacement
from identification.engine.claims import NEVER_CLAIMED, Claim, GateResult, Outcome, could_replace, until_failed
from identification.gates import ORDER, gate_name
from identification.gates.exchange import explains_more_than_others
from identification.gates.in_band import torque_is_there

# The gain of an effect in place of a finding is computed for at most this many findings: on robots with many joints,
# most findings have nothing to do with the effect.
_MOST_FINDINGS = 12
# Largest number of effects for which `_figures` is computed.
_MOST_MEASURED = 40
# Order of the first gate of the judge; gates with a lower order belong to the search.
_FIRST_OF_JUDGE = ORDER[gate_name(torque_is_there)]
_Replacements = dict[EffectJoint, tuple[EffectJoint, ...]]
_RANK: dict[Outcome, int] = {"claimed": 0, "minor": 1, "displaced": 2, "not_claimed": 2}


@dataclass(frozen=True)
class _BestGains:
    """In-sample gains of an effect that is not in a set.

    Attributes:
        term: The effect, in the shape that gains most.
        added_gain: Gain if the effect is added to the set.
        swap_gain: Largest gain if the effect replaces one effect of the set.
        other: The effect of the set that is then replaced; None if no replacement was possible.
        replaced_gain: Gain of that replaced effect itself.
    """

    term: Term
    added_gain: float = 0.0
    swap_gain: float = 0.0
    other: Term | None = None
    replaced_gain: float = 0.0


def ledger_of(
    search: Search, shown: ShownEffects, judged: JudgedBand, minor: frozenset[EffectJoint]
) -> tuple[Claim[EffectAt], ...]:
    """The entries of the ledger: findings first, then other effects by the share of the gap that each closes alone.

    Args:
        search: The search, with its record of decisions.
        shown: Effects that passed all gates of the judge.
        judged: Problem and noise floor of the judged band.
        minor: Effects and joints of findings that are too small to matter.
    """
    # A cause is an effect and its joint: shapes of an effect share one entry.
    record, named = search.record, {term.effect_joint for term in shown.named}
    best = _best_gains(search, shown.all_found)
    ranked = sorted(best, key=lambda cause: -max(best[cause].added_gain, best[cause].swap_gain))
    unclaimed = [cause for cause in ranked if cause not in record.claimed and cause not in named][:NEVER_CLAIMED]
    gates, replacements = {}, {}
    for cause in (*record.claimed, *unclaimed):
        results = sorted(record.results_of(cause), key=lambda result: ORDER[result.gate])
        gates[cause] = until_failed(results)
        replacements[cause] = record.replacements_of(cause)
        failed = next((result for result in results if not result.passed), None)
        failed_in_judge = failed is not None and ORDER[failed.gate] >= _FIRST_OF_JUDGE
        if cause in named or failed_in_judge:
            continue
        if cause in best:
            # The search decided with another set of effects: its gates are applied once more to the effect in addition
            # to the final set. If all pass now, a failure in the search remains in the ledger.
            results_if_added, others = _results_if_added(search, shown.all_found, best[cause])
            if not results_if_added[-1].passed or failed is None:
                gates[cause], replacements[cause] = results_if_added, others
    terms = {cause: best[cause].term for cause in gates if cause in best}
    terms |= {term.effect_joint: term for term in shown.all_found if term.effect_joint in gates}
    terms |= {term.effect_joint: term for term in shown.named}
    figures = _figures(shown, judged, terms, replacements)
    entries = []
    for cause, results in gates.items():
        outcome: Outcome = "displaced" if replacements[cause] else "not_claimed"
        if cause in named:
            outcome = "minor" if cause in minor else "claimed"
        others = tuple(EffectAt(*other) for other in replacements[cause])
        entries.append(Claim((EffectAt(*cause),), results, outcome, others, figures.get(cause, {})))
    return tuple(sorted(entries, key=lambda entry: (_RANK[entry.outcome], -entry.figures.get("closes", -np.inf))))


def _best_gains(search: Search, found: frozenset[Term]) -> dict[EffectJoint, _BestGains]:
    """In-sample gains of each effect outside of a set: if it is added, and if it replaces one effect of the set.

    The gains are computed to second order, without a new fit.
    """
    in_set = {term.effect_joint for term in found}
    named = tuple(term for term in search.terms if term.named and term.effect_joint not in in_set)
    out: dict[EffectJoint, _BestGains] = {}
    # Each effect is first added to the set (other is None), and then replaces one effect of the set after another.
    for other in (None, *ordered(found)[:_MOST_FINDINGS]):
        remaining = found - {other}
        rivals = tuple(term for term in named if search.can_join(remaining, term))
        gains = search.fits.gains(remaining, rivals if other is None else (*rivals, other))
        for term in rivals:
            best, gain = out.setdefault(term.effect_joint, _BestGains(term)), gains[term]
            if other is None and gain > best.added_gain:
                out[term.effect_joint] = replace(best, term=term, added_gain=gain)
            elif other is not None and gain > best.swap_gain:
                swap = {"swap_gain": gain, "other": other, "replaced_gain": gains[other]}
                out[term.effect_joint] = replace(best, term=term, **swap)
    return out


def _results_if_added(
    search: Search, found: frozenset[Term], best: _BestGains
) -> tuple[tuple[GateResult, ...], tuple[EffectJoint, ...]]:
    """Results of the search's gates for an effect that is added to a set, and which effect of the set displaces it.

    An effect that fails is displaced by the effect that it could replace (`could_replace`). In place of that effect it
    has to gain enough for a claim, more than twice its gain in addition to the set, and a fair part of the gain of the
    replaced effect.

    Args:
        search: Rivals and fits.
        found: The set.
        best: The tested effect, with its gains.
    """
    term, other = best.term, best.other
    if not can_join(found, term):
        # The effect is a special case of a law in the set: the law displaces it.
        law = next(one for one in ordered(found) if not can_join(frozenset([one]), term))
        margin = search.score(found) - search.score(with_replacement(found, law, frozenset([term])))
        return (explains_more_than_others(margin),), (law.effect_joint,)
    together = with_term(found, term)
    results = gate_results(search, together, found)
    if results[-1].passed:
        return (*results, explains_more_than_others(search.score(found) - search.score(together))), ()
    needed = search.threshold.of(term) + max(price(search.counts[term]) - price(1), 0.0)
    if other is None or not could_replace(best.swap_gain, needed, best.added_gain, best.replaced_gain):
        return results, ()
    return results, (other.effect_joint,)


def _figures(
    shown: ShownEffects, judged: JudgedBand, terms: dict[EffectJoint, Term], replacements: _Replacements
) -> dict[EffectJoint, dict[str, float]]:
    """Two figures of each effect: ``closes``, the share of the gap that it closes alone, and ``floors_more``.

    ``floors_more`` is the largest growth of a joint's residual, in noise floors, if the effect replaces the findings
    that displace it.
    """
    measured = dict(list(terms.items())[:_MOST_MEASURED])
    residual_with = _subset_residuals(shown, frozenset(measured.values()))
    within, after = residual_with(frozenset()), residual_with(shown.named)
    equal_weights = np.ones((1, len(within.counts)))
    gap = float(gap_of(judged, within, after, equal_weights)[0])
    loss_within = float(within.loss(judged.floor, equal_weights)[0])
    out: dict[EffectJoint, dict[str, float]] = {}
    for cause, term in measured.items():
        loss_alone = float(residual_with(frozenset([term])).loss(judged.floor, equal_weights)[0])
        out[cause] = {"closes": (loss_within - loss_alone) / gap}
        others = frozenset(one for one in shown.named if one.effect_joint in replacements.get(cause, ()))
        if others:
            swapped = residual_with(with_term(shown.named - others, term))
            out[cause]["floors_more"] = float(np.max((swapped.rms() - after.rms()) / judged.floor))
    return out


def _subset_residuals(shown: ShownEffects, terms: frozenset[Term]) -> Callable[[frozenset[Term]], ResidualSums]:
    """Function that returns the squared residuals with a subset of the findings and of further effects in the model.

    Subsets of linear effects are fitted quickly, from products that are computed once. This is not possible with a
    torque constant or a payload, so these effects are fitted separately.
    """
    linear = frozenset(term for term in terms if not (term.effect.scales_joint or term.effect.inertial == "point mass"))
    with_linear = subset_residuals(shown.plain, shown.named | linear)
    with_others = subset_residuals(shown.plain, shown.named | (terms - linear))
    return lambda chosen: with_linear(chosen) if chosen <= shown.named | linear else with_others(chosen)


def coarse_claims(search: Search, rounding: CoarseRounding) -> tuple[Claim[EffectAt], ...]:
    """Entries of encoders whose steps in the recording are larger than expected."""
    joints = search.problem.session.robot.joint_names
    return tuple(
        Claim(
            (EffectAt("encoder_quantization", joints[one.row]),),
            (one.coarser, matters),
            "claimed" if matters.passed else "not_claimed",
        )
        for one, matters in rounding.results
    )
