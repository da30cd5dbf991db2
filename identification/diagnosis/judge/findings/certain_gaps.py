"""Tests whether the highest possible noise could cause the gap that an effect closes."""

from __future__ import annotations

import numpy as np

from identification.diagnosis.columns.terms import Term
from identification.diagnosis.fit.gap import residual_sums
from identification.diagnosis.judge.findings.gate_state import GateContext
from identification.diagnosis.judge.shares import residual_sums_with
from identification.engine import contract_levels
from phantom_dyn.array_types import Array, Bool


def closes_certain_gap(context: GateContext, shown: frozenset[Term], term: Term) -> bool:
    """True if a joint has a gap without an effect and none with it, even if its noise is the highest possible."""
    without = _has_gap(context, shown - {term}, in_highest_noise=True)
    return bool(without.any() and (without & ~_has_gap(context, shown, in_highest_noise=True)).any())


def gain_in_highest_noise(context: GateContext, shown: frozenset[Term], term: Term) -> tuple[float, float]:
    """In-sample gain of an effect if each joint has its largest possible noise, and the gain by chance.

    Only joints count that have a gap without the effect and no gap with it: most of the largest possible noise is
    uncertain friction, which repeats with the motion, so that chance does not limit the gain of an effect from it. But
    uncertain friction hardly ever has the shape of an effect, so that a gap would remain with the effect. Gains are
    multiplied by the squared ratio of the noise by which fits are weighted to the largest possible noise.
    """
    fits, problem, others = context.search.fits, context.search.problem, shown - {term}
    noise_of_weights = residual_sums(problem, problem.session.in_judged_band(context.noise)).rms()
    largest_noise = np.maximum(context.residuals.judged_band_of(others).highest, noise_of_weights)
    counted = _has_gap(context, others) & ~_has_gap(context, shown)
    gains = np.where(counted, fits.row_losses(others) - fits.row_losses(shown), 0.0)
    noise_ratio = noise_of_weights / np.maximum(largest_noise, 1e-300)
    return float(gains @ noise_ratio**2), context.search.threshold.of(term)


def _has_gap(context: GateContext, terms: frozenset[Term], *, in_highest_noise: bool = False) -> Bool[Array, " nv"]:
    """True for joints with a gap if some effects are in the model, in the estimated or the highest possible noise."""
    judged = context.residuals.judged_band_of(terms)
    noise = judged.highest if in_highest_noise else judged.floor
    return residual_sums_with(context.plain, terms).rms() > contract_levels.FLOORS_LEFT * noise
