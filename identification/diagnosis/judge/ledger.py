"""The ledger of a diagnosis: every effect that was claimed at any time, and the ten best of those that never were.

Search and judge record their decisions as they make them. This module compares each effect that is not a finding with
the final set once more: how much the effect gains when it is added, which share of the gap it closes alone, and which
findings explain that share instead.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from identification.diagnosis.columns.terms import Term, ordered
from identification.diagnosis.fit.gap import ResidualSums
from identification.diagnosis.judge.coarse_encoders import CoarseRounding
from identification.diagnosis.judge.findings.bench import Shown
from identification.diagnosis.judge.judged_band import Judge
from identification.diagnosis.judge.shares import gap_of
from identification.diagnosis.result import EffectAt
from identification.diagnosis.search.claims import gate_results
from identification.diagnosis.search.containment import can_join, with_term
from identification.diagnosis.search.record import EffectJoint
from identification.diagnosis.search.search import Search, price
from identification.diagnosis.search.subset_residuals import subset_residuals
from identification.diagnosis.search.swaps import with_replacement
from identification.engine.claims import NEVER_CLAIMED, Claim, GateResult, Outcome, could_stand_for, until_failed
from identification.gates import ORDER, gate_name
from identification.gates.exchange import explains_more_than_others
from identification.gates.in_band import torque_is_there

# Most findings in whose place the gain of another effect is computed; in robots with many joints most are unrelated.
_MOST_FINDINGS = 12
# Effects whose figures are computed in the judged band.
_MOST_MEASURED = 40
# Gates of the search come before this one.
_FIRST_OF_JUDGE = ORDER[gate_name(torque_is_there)]
_RANK: dict[Outcome, int] = {"claimed": 0, "minor": 1, "displaced": 2, "not_claimed": 2}


@dataclass(frozen=True)
class _BestGains:
    """In-sample gains of an effect, with its best shape.

    Attributes:
        term: The effect.
        beside: Gain if it is added to a set.
        instead_of: Gain if it replaces one effect of the set.
        other: That effect.
        of_other: Gain of that effect itself.
    """

    term: Term
    beside: float = 0.0
    instead_of: float = 0.0
    other: Term | None = None
    of_other: float = 0.0


def ledger_of(search: Search, shown: Shown, judge: Judge, minor: frozenset[EffectJoint]) -> tuple[Claim[EffectAt], ...]:
    """The entries of the ledger: claims first, then the effects that came nearest.

    Args:
        search: The search, with its record of decisions.
        shown: Effects that passed all gates of the judge.
        judge: Problem and floor of the gap.
        minor: Places of findings that are too small to matter.
    """
    record, named = search.record, {term.effect_joint for term in shown.named}
    near = _best_gains(search, shown.all_found)
    ranked = sorted(near, key=lambda cause: -max(near[cause].beside, near[cause].instead_of))
    never = [cause for cause in ranked if cause not in record.claimed and cause not in named][:NEVER_CLAIMED]
    gates, replacements = {}, {}
    for cause in (*record.claimed, *never):
        results = sorted(record.results_of(cause), key=lambda result: ORDER[result.gate])
        gates[cause] = until_failed(results)
        replacements[cause] = record.replacements_of(cause)
        failed = next((result for result in results if not result.passed), None)
        if cause in named or (failed is not None and ORDER[failed.gate] >= _FIRST_OF_JUDGE):
            continue
        if cause in near:
            # The search decided with another set of effects: its gates are applied once more beside the final set.
            results_beside, others = _results_beside(search, shown.all_found, near[cause])
            if not results_beside[-1].passed or failed is None:
                gates[cause], replacements[cause] = results_beside, others
    terms = {cause: near[cause].term for cause in gates if cause in near}
    terms |= {term.effect_joint: term for term in shown.all_found if term.effect_joint in gates}
    terms |= {term.effect_joint: term for term in shown.named}
    figures = _figures(shown, judge, terms, replacements)
    entries = []
    for cause, results in gates.items():
        outcome: Outcome = "displaced" if replacements[cause] else "not_claimed"
        if cause in named:
            outcome = "minor" if cause in minor else "claimed"
        others = tuple(EffectAt(*other) for other in replacements[cause])
        entries.append(Claim((EffectAt(*cause),), results, outcome, others, figures.get(cause, {})))
    return tuple(sorted(entries, key=lambda entry: (_RANK[entry.outcome], -entry.figures.get("closes", -np.inf))))


def _best_gains(search: Search, found: frozenset[Term]) -> dict[EffectJoint, _BestGains]:
    """In-sample gains of each effect outside of a set: added to it, and in place of one of its effects.

    The gains are computed to second order, without a new fit.
    """
    taken = {term.effect_joint for term in found}
    named = tuple(term for term in search.terms if term.named and term.effect_joint not in taken)
    out: dict[EffectJoint, _BestGains] = {}
    for other in (None, *ordered(found)[:_MOST_FINDINGS]):
        remaining = found - {other}
        rivals = tuple(term for term in named if search.can_join(remaining, term))
        gains = search.fits.gains(remaining, rivals if other is None else (*rivals, other))
        for term in rivals:
            known = out.setdefault(term.effect_joint, _BestGains(term))
            if other is None and gains[term] > known.beside:
                out[term.effect_joint] = replace(known, term=term, beside=gains[term])
            elif other is not None and gains[term] > known.instead_of:
                own = gains[other]
                out[term.effect_joint] = replace(known, term=term, instead_of=gains[term], other=other, of_other=own)
    return out


def _results_beside(
    search: Search, found: frozenset[Term], near: _BestGains
) -> tuple[tuple[GateResult, ...], tuple[EffectJoint, ...]]:
    """Results of the search's gates for an effect beside a set; if it fails, also the effect that displaces it.

    An effect of the set displaces the tested one if, without it, the tested one gains enough for a claim, more than
    twice its gain beside the whole set, and a fair part of the gain of the other effect (`could_stand_for`).
    """
    term, other = near.term, near.other
    if not can_join(found, term):
        # A special case of a law in the set is replaced by that law.
        rich = next(one for one in ordered(found) if not can_join(frozenset([one]), term))
        margin = search.score(found) - search.score(with_replacement(found, rich, frozenset([term])))
        return (explains_more_than_others(margin),), (rich.effect_joint,)
    together = with_term(found, term)
    results = gate_results(search, together, found)
    if results[-1].passed:
        return (*results, explains_more_than_others(search.score(found) - search.score(together))), ()
    needed = search.threshold.of(term) + max(price(search.sizes[term]) - price(1), 0.0)
    if other is None or not could_stand_for(near.instead_of, needed, near.beside, near.of_other):
        return results, ()
    return results, (other.effect_joint,)


def _figures(
    shown: Shown, judge: Judge, terms: dict[EffectJoint, Term], replacements: dict[EffectJoint, tuple[EffectJoint, ...]]
) -> dict[EffectJoint, dict[str, float]]:
    """Further figures of each effect: ``closes`` and ``floors_more``.

    ``closes`` is the share of the gap that the effect closes alone. ``floors_more`` is the largest growth of a joint's
    residual, in noise floors, if the effect takes the place of the effects that displace it.
    """
    measured = dict(list(terms.items())[:_MOST_MEASURED])
    left = _subset_residuals(shown, frozenset(measured.values()))
    within, after = left(frozenset()), left(shown.named)
    once = np.ones((1, len(within.counts)))
    gap = float(gap_of(judge, within, after, once)[0])
    base = float(within.loss(judge.floor, once)[0])
    out: dict[EffectJoint, dict[str, float]] = {}
    for cause, term in measured.items():
        alone = float(left(frozenset([term])).loss(judge.floor, once)[0])
        out[cause] = {"closes": (base - alone) / gap}
        others = frozenset(one for one in shown.named if one.effect_joint in replacements.get(cause, ()))
        if others:
            swapped = left(with_term(shown.named - others, term))
            out[cause]["floors_more"] = float(np.max((swapped.rms() - after.rms()) / judge.floor))
    return out


def _subset_residuals(shown: Shown, terms: frozenset[Term]) -> Callable[[frozenset[Term]], ResidualSums]:
    """Function that gives squared residuals of any subset of named and other effects; linear ones are kept apart."""
    linear = frozenset(term for term in terms if not (term.effect.scales_joint or term.effect.inertial == "point mass"))
    of_linear, of_others = (subset_residuals(shown.plain, shown.named | some) for some in (linear, terms - linear))
    return lambda chosen: of_linear(chosen) if chosen <= shown.named | linear else of_others(chosen)


def coarse_claims(search: Search, rounding: CoarseRounding) -> tuple[Claim[EffectAt], ...]:
    """Entries of encoders whose readings lie on a coarser lattice than expected."""
    joints = search.problem.session.robot.joint_names
    return tuple(
        Claim(
            (EffectAt("encoder_quantization", joints[one.row]),),
            (one.coarser, matters),
            "claimed" if matters.passed else "not_claimed",
        )
        for one, matters in rounding.results
    )
