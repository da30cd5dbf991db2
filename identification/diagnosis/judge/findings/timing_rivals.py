"""Compares a drive's delay or lag with other laws of lateness, at frequencies where the motion is far above the noise.

The torque of a delay or a lag is computed from the rate of the needed torque. At frequencies above those of the motion
that rate is noise, and the noise of a lag differs from that of a delay. There the residual says which of the two has
less noise, and not which one the drive has. So these frequencies are left out. They are kept if the residual of one law
would be a gap beside that of the other: noise does not make such a difference.
"""

from __future__ import annotations

import numpy as np

from identification.diagnosis.columns.terms import Term
from identification.diagnosis.judge.findings.bench import Bench
from identification.diagnosis.judge.moved_by_noise import strong_motion_search
from identification.diagnosis.judge.shares import residual_sums_with
from identification.diagnosis.search.fits import Chosen
from identification.diagnosis.search.record import EffectJoint
from identification.diagnosis.search.special_cases import simplest_effects
from identification.diagnosis.search.swaps import with_replacement
from identification.engine.contract_levels import FLOORS_LEFT
from identification.gates.above_chance import PARAMETER_PRICE
from phantom_dyn.array_types import Array


def losses_beyond(bench: Bench, found: Chosen, term: Term, barred: frozenset[EffectJoint]) -> dict[Chosen, Array]:
    """Held-out losses, by block, of sets with another law of timing beyond the loss of the set with a finding.

    They are computed at frequencies where the torque of the motion is far above the noise. The difference of penalties
    is added, spread evenly over the blocks. Then all are scaled so that the sum comes nearer to zero by the price of a
    parameter, which a law gains by chance, and at most to zero.

    Args:
        bench: Searches and fits.
        found: A set of effects.
        term: One of them.
        barred: Effects and joints that are excluded as rivals.

    Returns:
        Losses by set, with the best shape of each rival; none if the finding is no law of timing. Rivals with a far
        larger or smaller residual on some joint are left out: noise does not make that.
    """
    if not _is_of_timing(term):
        return {}
    rivals = _comparable(bench, found, term, barred)
    if not rivals:
        return {}
    strong, terms = strong_motion_search(bench.plain, found, found.union(rivals.values()), bench.noise)
    base = strong.held_out_fit(frozenset(terms[one] for one in found))
    best = dict[EffectJoint, tuple[float, Chosen, Array]]()
    for swapped, rival in rivals.items():
        fit = strong.held_out_fit(frozenset(terms[one] for one in swapped))
        if simplest_effects(strong.problem.session.robot, terms[rival], fit) is None:
            continue
        worse = fit.loss - base.loss + (fit.penalty - base.penalty) / len(base.loss)
        total = float(worse.sum())
        kept = max(1.0 - PARAMETER_PRICE / max(abs(total), PARAMETER_PRICE), 0.0)
        if rival.effect_joint not in best or total < best[rival.effect_joint][0]:
            best[rival.effect_joint] = total, swapped, kept * worse
    return {swapped: loss for _, swapped, loss in best.values()}


def _comparable(bench: Bench, found: Chosen, term: Term, barred: frozenset[EffectJoint]) -> dict[Chosen, Term]:
    """Sets with another law of timing in place of a finding, beside which neither leaves a gap, and these laws."""
    residual, out = np.maximum(residual_sums_with(bench.plain, found).rms(), 1e-300), dict[Chosen, Term]()
    for rival in bench.search.terms:
        same_place = rival.joint == term.joint or None in (rival.joint, term.joint)
        if not _is_of_timing(rival) or rival.effect is term.effect or not same_place or rival.effect_joint in barred:
            continue
        swapped = with_replacement(found, term, frozenset([rival]))
        if rival not in swapped:
            continue
        times = residual_sums_with(bench.plain, swapped).rms() / residual
        if times.max() <= FLOORS_LEFT and times.min() >= 1.0 / FLOORS_LEFT:
            out[swapped] = rival
    return out


def _is_of_timing(term: Term) -> bool:
    """True for laws of a late torque, such as a delay."""
    return term.effect.follows_torque and term.effect.uses_acceleration
