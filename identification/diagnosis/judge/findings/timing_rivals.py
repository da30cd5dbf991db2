"""Compares laws of a late torque, such as delay and lag, at frequencies where the motion is far above the noise.

The torque of a delay or a lag is computed from the rate of change of the needed torque. Above the frequencies of the
motion this rate is noise, and the residual only shows which law amplifies the noise less. So these frequencies are left
out, unless the residuals of two laws differ so much that the larger one would count as a gap: noise is then not the
reason, and all frequencies are compared.
"""

from __future__ import annotations

import numpy as np

from identification.diagnosis.columns.terms import Term
from identification.diagnosis.judge.findings.gate_state import GateContext
from identification.diagnosis.judge.shares import residual_sums_with
from identification.diagnosis.judge.strong_motion import strong_motion_search
from identification.diagnosis.search.fits import Chosen
from identification.diagnosis.search.record import EffectJoint
from identification.diagnosis.search.special_cases import simplest_effects
from identification.diagnosis.search.swaps import with_replacement
from identification.engine.contract_levels import FLOORS_LEFT
from identification.gates.above_chance import PARAMETER_PRICE
from phantom_dyn.array_types import Array


def strong_motion_loss_increases(
    context: GateContext, found: Chosen, term: Term, barred: frozenset[EffectJoint]
) -> dict[Chosen, Array]:
    """Increase of the held-out loss in each block if another law of a late torque replaces a finding.

    The losses are computed at frequencies where the torque of the motion is far above the noise, and include the
    penalties of the fits, spread evenly over the blocks. One law gains the price of a parameter over another by chance.
    So the increases are scaled until their sum is nearer to zero by this price, at most to zero.

    Args:
        context: Searches and fits.
        found: A set of effects.
        term: The finding, one effect of the set.
        barred: Effects and joints that are excluded as rivals.

    Returns:
        Increases by the set with the rival, ``(B,)`` each, for the best shape of each rival. The result is empty if the
        finding is no law of a late torque. Rivals of which all frequencies are compared are left out.
    """
    if not _is_late_torque(term):
        return {}
    rivals = _close_rivals(context, found, term, barred)
    if not rivals:
        return {}
    strong, terms = strong_motion_search(context.plain, found, found.union(rivals.values()), context.noise)
    base = strong.held_out_fit(frozenset(terms[one] for one in found))
    best = dict[EffectJoint, tuple[float, Chosen, Array]]()
    for swapped, rival in rivals.items():
        fit = strong.held_out_fit(frozenset(terms[one] for one in swapped))
        if simplest_effects(strong.problem.session.robot, terms[rival], fit) is None:
            continue
        increase = fit.loss - base.loss + (fit.penalty - base.penalty) / len(base.loss)
        total = float(increase.sum())
        factor = max(1.0 - PARAMETER_PRICE / max(abs(total), PARAMETER_PRICE), 0.0)
        if rival.effect_joint not in best or total < best[rival.effect_joint][0]:
            best[rival.effect_joint] = total, swapped, factor * increase
    return {swapped: increase for _, swapped, increase in best.values()}


def hidden_twins(found: Chosen, shown: Chosen) -> Chosen:
    """Laws of a late torque that are not shown, while another such law is shown on the same joint, or on all joints.

    Where the motion is far above the noise, a lag may add nothing to a delay, or the reverse. It then fails the gate
    `shown_by_motion`. If it remained in the set, it could not be a rival of the other law.

    Args:
        found: A set of effects.
        shown: Those of them that have passed all gates so far.
    """
    late = [term for term in shown if _is_late_torque(term)]
    return frozenset(
        term
        for term in found - shown
        if _is_late_torque(term) and any(term.joint == one.joint and term.effect is not one.effect for one in late)
    )


def _close_rivals(
    context: GateContext, found: Chosen, term: Term, barred: frozenset[EffectJoint]
) -> dict[Chosen, Term]:
    """Rivals whose residual differs so little from the finding's that noise may be the reason, by the resulting set."""
    residual, out = np.maximum(residual_sums_with(context.plain, found).rms(), 1e-300), dict[Chosen, Term]()
    for rival in context.search.terms:
        same_place = rival.joint == term.joint or None in (rival.joint, term.joint)
        is_other_law = _is_late_torque(rival) and rival.effect is not term.effect
        if not is_other_law or not same_place or rival.effect_joint in barred:
            continue
        swapped = with_replacement(found, term, frozenset([rival]))
        if rival not in swapped:
            continue
        ratio = residual_sums_with(context.plain, swapped).rms() / residual
        if ratio.max() <= FLOORS_LEFT and ratio.min() >= 1.0 / FLOORS_LEFT:
            out[swapped] = rival
    return out


def _is_late_torque(term: Term) -> bool:
    """True for laws of a late torque, such as a delay or a lag."""
    return term.effect.follows_torque and term.effect.uses_acceleration
