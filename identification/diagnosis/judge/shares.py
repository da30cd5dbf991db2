"""Share of the gap that the findings close, together and each of them (Shapley value)."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from identification.diagnosis.columns.terms import Term, ordered
from identification.diagnosis.fit.gap import ResidualSums, held_out_torque, residual_after, residual_sums
from identification.diagnosis.judge.judged_band import Judge
from identification.diagnosis.result import Gap
from identification.diagnosis.search.containment import are_near_twins
from identification.diagnosis.search.search import Search
from identification.diagnosis.search.subset_residuals import subset_residuals
from identification.engine import contract_levels
from identification.engine.resampling import block_counts
from identification.engine.shapley import shapley_values
from phantom_dyn.array_types import Array, Float
from phantom_dyn.random_streams import random_stream

_LEAST_GAP = 1e-3  # of the loss, in every bootstrap replicate


def residual_sums_with(plain: Search, chosen: frozenset[Term]) -> ResidualSums:
    """Squared residuals in the judged band of the corrected model with some effects, on blocks held out of its fit."""
    torque = held_out_torque(plain.problem, chosen, plain.held_out_fit(chosen))
    return residual_sums(plain.problem, plain.problem.session.in_judged_band(residual_after(plain.problem, torque)))


def exceeds_floor(judge: Judge, within: ResidualSums) -> bool:
    """True if the loss after the best changes within tolerance is more than the noise floor's interval allows."""
    once = np.ones((1, len(within.counts)))
    return float(within.loss(judge.floor, once)[0]) > float(np.mean((judge.highest / judge.floor) ** 2))


def gap_of(judge: Judge, within: ResidualSums, after: ResidualSums, weights: Float[Array, "R B"]) -> Float[Array, " R"]:
    """The gap of which shares are stated: loss after the best changes within tolerance, above the noise.

    A loss is the mean square in units of the noise floor, over weighted blocks. The mean loss may be below the
    noise while one joint is above it: then the gap is the loss that the findings close.
    """
    base = within.loss(judge.floor, weights)
    beyond = base - 1.0 if exceeds_floor(judge, within) else base - after.loss(judge.floor, weights)
    # In a replicate with next to no gap a share would have no meaning.
    return np.maximum(beyond, _LEAST_GAP * base)


def drawn_blocks(counted: ResidualSums) -> Float[Array, "R B"]:
    """How often each block is drawn in each bootstrap replicate of the gap; the same draws for all findings."""
    return block_counts(len(counted.counts), random_stream("bootstrap of the gap closed"))


def least_shares_closed(
    left: Callable[[frozenset[Term]], ResidualSums], chosen: frozenset[Term], sound: Float[Array, " nv"]
) -> dict[Term, float]:
    """The loss that each effect removes for sure (2.5 % of the bootstrap), divided by the loss that it removes.

    The residual of each joint is divided by that of a sound model or, if larger, by the residual with all effects over
    the largest that is no gap: else a joint with a large unexplained residual would hide the gap that an effect closes
    on another joint. It is minus one for an effect that closes nothing. Near twins are left out, as each closes the gap
    of the other.

    Args:
        left: Gives the squared residuals of a set of effects in the judged band.
        chosen: The effects.
        sound: Residual of each joint with a sound model.
    """
    base, out = left(chosen), {}
    once, drawn = np.ones((1, len(base.counts))), drawn_blocks(base)
    scale = np.maximum(sound, base.rms() / contract_levels.FLOORS_LEFT)
    for term in ordered(chosen):
        if any(are_near_twins(term, other) for other in chosen):
            continue
        without = left(chosen - {term})
        closed, draws = (without.loss(scale, weights) - base.loss(scale, weights) for weights in (once, drawn))
        out[term] = float(np.percentile(draws, 2.5) / closed[0]) if closed[0] > 0.0 else -1.0
    return out


def closed_together(judge: Judge, within: ResidualSums, after: ResidualSums) -> Gap:
    """Share of the gap within tolerance that the findings close, with its interval from a block bootstrap.

    Args:
        judge: Gives the noise floor.
        within: Residual of the best changes within the tolerances.
        after: Residual of the corrected model.
    """
    if not exceeds_floor(judge, within):
        return Gap()
    once, drawn = (
        (within.loss(judge.floor, weights) - after.loss(judge.floor, weights)) / gap_of(judge, within, after, weights)
        for weights in (np.ones((1, len(within.counts))), drawn_blocks(within))
    )
    low, high = np.percentile(drawn, [2.5, 97.5])
    return Gap(float(once[0]), (float(low), float(high)))


def shares_of(judge: Judge, plain: Search, named: frozenset[Term]) -> dict[Term, float]:
    """Shapley value of each finding in the share of the gap that all close.

    The tolerance parameters are fitted again in every coalition.

    Args:
        judge: Gives the noise floor.
        plain: Fits in the judged band.
        named: The findings.
    """
    left = subset_residuals(plain, named)
    within, after = left(frozenset()), left(named)
    once = np.ones((1, len(within.counts)))
    base, gap = within.loss(judge.floor, once)[0], gap_of(judge, within, after, once)[0]

    @cache
    def closed(chosen: frozenset[Term]) -> float:
        return float((base - left(chosen).loss(judge.floor, once)[0]) / gap)

    return shapley_values(ordered(named), closed)
