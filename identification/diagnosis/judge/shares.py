"""Share of the gap that the findings close: all together, and each by its Shapley value."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from identification.diagnosis.columns.terms import Term, ordered
from identification.diagnosis.fit.gap import ResidualSums, held_out_torque, residual_after, residual_sums
from identification.diagnosis.judge.judged_band import JudgedBand
from identification.diagnosis.result import Gap
from identification.diagnosis.search.containment import are_near_twins
from identification.diagnosis.search.search import Search
from identification.diagnosis.search.subset_residuals import subset_residuals
from identification.engine import contract_levels
from identification.engine.resampling import block_counts
from identification.engine.shapley import shapley_values
from phantom_dyn.array_types import Array, Float
from phantom_dyn.random_streams import random_stream

# The gap counts as at least this share of the loss: a share of next to no gap, as in some replicates, has no meaning.
_LEAST_GAP = 1e-3


def residual_sums_with(plain: Search, chosen: frozenset[Term]) -> ResidualSums:
    """Squared residuals of the model with some effects on held-out blocks, in the judged band."""
    torque = held_out_torque(plain.problem, chosen, plain.held_out_fit(chosen))
    return residual_sums(plain.problem, plain.problem.session.in_judged_band(residual_after(plain.problem, torque)))


def exceeds_floor(judged: JudgedBand, within: ResidualSums) -> bool:
    """True if the model adjusted within its tolerances has a larger loss than the noise may have.

    The largest loss of noise is that of the upper ends of the noise floors.
    """
    equal_weights = np.ones((1, len(within.counts)))
    return float(within.loss(judged.floor, equal_weights)[0]) > float(np.mean((judged.highest / judged.floor) ** 2))


def gap_of(
    judged: JudgedBand, within: ResidualSums, after: ResidualSums, weights: Float[Array, "R B"]
) -> Float[Array, " R"]:
    """The gap of which shares are stated, one for each row of weights.

    A loss is the mean squared residual of all joints in units of their noise floors; that of noise alone is one. The
    gap is the loss of the model adjusted within its tolerances minus one. If that loss may be noise, although one joint
    is above its noise, the gap is the decrease of the loss by the findings.

    Args:
        judged: Gives the noise floors.
        within: Residual of the model adjusted within its tolerances.
        after: Residual of the corrected model.
        weights: Weights of the blocks, one row for each loss, ``(R, B)``.
    """
    loss_within = within.loss(judged.floor, weights)
    gap = loss_within - 1.0 if exceeds_floor(judged, within) else loss_within - after.loss(judged.floor, weights)
    return np.maximum(gap, _LEAST_GAP * loss_within)


def drawn_blocks(counted: ResidualSums) -> Float[Array, "R B"]:
    """How often each block is drawn in each bootstrap replicate of the gap; all findings get the same draws."""
    return block_counts(len(counted.counts), random_stream("bootstrap of the gap closed"))


def least_shares_closed(
    residual_with: Callable[[frozenset[Term]], ResidualSums], chosen: frozenset[Term], sound: Float[Array, " nv"]
) -> dict[Term, float]:
    """Lower end of the 95 % interval of the loss that each effect removes, divided by the loss that it removes.

    The result is -1 for an effect that removes no loss. Effects are left out if another effect in the set makes nearly
    the same torque (near twins), because each of the two would then remove no loss.

    Residuals count in units of a scale for each joint: the residual of a sound model, or that of all effects together
    divided by `FLOORS_LEFT` if this is larger. Otherwise a joint with a large residual would hide what an effect
    explains on another joint.

    Args:
        residual_with: Function that returns the squared residuals in the judged band with a set of effects.
        chosen: The effects.
        sound: Root mean square residual of each joint with a sound model, ``(nv,)``.
    """
    with_all, out = residual_with(chosen), {}
    equal_weights, drawn = np.ones((1, len(with_all.counts))), drawn_blocks(with_all)
    scale = np.maximum(sound, with_all.rms() / contract_levels.FLOORS_LEFT)
    for term in ordered(chosen):
        if any(are_near_twins(term, other) for other in chosen):
            continue
        without = residual_with(chosen - {term})
        (removed,) = without.loss(scale, equal_weights) - with_all.loss(scale, equal_weights)
        draws = without.loss(scale, drawn) - with_all.loss(scale, drawn)
        out[term] = float(np.percentile(draws, 2.5) / removed) if removed > 0.0 else -1.0
    return out


def closed_together(judged: JudgedBand, within: ResidualSums, after: ResidualSums) -> Gap:
    """Share of the gap within tolerance that the findings close, with its interval from a block bootstrap.

    Args:
        judged: Gives the noise floors.
        within: Residual of the model adjusted within its tolerances.
        after: Residual of the corrected model.
    """
    if not exceeds_floor(judged, within):
        return Gap()

    def share(weights: Float[Array, "R B"]) -> Float[Array, " R"]:
        closed = within.loss(judged.floor, weights) - after.loss(judged.floor, weights)
        return closed / gap_of(judged, within, after, weights)

    (whole,) = share(np.ones((1, len(within.counts))))
    low, high = np.percentile(share(drawn_blocks(within)), [2.5, 97.5])
    return Gap(float(whole), (float(low), float(high)))


def shares_of(judged: JudgedBand, plain: Search, named: frozenset[Term]) -> dict[Term, float]:
    """Shapley value of each finding: its part of the share of the gap that all findings close together.

    The tolerance parameters are fitted again for each subset of the findings.

    Args:
        judged: Gives the noise floors.
        plain: Fits in the judged band.
        named: The findings.
    """
    residual_with = subset_residuals(plain, named)
    within, after = residual_with(frozenset()), residual_with(named)
    equal_weights = np.ones((1, len(within.counts)))
    loss_within, gap = within.loss(judged.floor, equal_weights)[0], gap_of(judged, within, after, equal_weights)[0]

    @cache
    def share_closed(chosen: frozenset[Term]) -> float:
        return float((loss_within - residual_with(chosen).loss(judged.floor, equal_weights)[0]) / gap)

    return shapley_values(ordered(named), share_closed)
