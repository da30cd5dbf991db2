"""Asks of a gap that an effect closes whether the highest possible noise could be its cause."""

from __future__ import annotations

import numpy as np

from identification.diagnosis.columns.terms import Term
from identification.diagnosis.fit.gap import residual_sums
from identification.diagnosis.judge.findings.bench import Bench
from identification.diagnosis.judge.shares import residual_sums_with
from identification.engine import contract_levels
from phantom_dyn.array_types import Array, Bool


def closes_certain_gap(bench: Bench, shown: frozenset[Term], term: Term) -> bool:
    """True if a joint has a gap without an effect and none with it, even if its noise is the highest possible."""
    without = _has_gap(bench, shown - {term}, in_highest_noise=True)
    return bool(without.any() and (without & ~_has_gap(bench, shown, in_highest_noise=True)).any())


def gain_in_highest_noise(bench: Bench, shown: frozenset[Term], term: Term) -> tuple[float, float]:
    """In-sample gain of an effect if each joint has its largest possible noise, and the gain by chance.

    Only joints count that have a gap without the effect and no gap with it. The reason: most of the largest possible
    noise is uncertain friction, which repeats with the motion, so that the gain of an effect from it has no limit by
    chance. But uncertain friction hardly ever has the shape of an effect, so that a gap would remain with the effect.
    Gains are reduced by the squared ratio of the noise by which fits are weighted to the largest possible noise.
    """
    fits, problem, others = bench.search.fits, bench.search.problem, shown - {term}
    noise_of_weights = residual_sums(problem, problem.session.in_judged_band(bench.noise)).rms()
    largest_noise = np.maximum(bench.residuals.judge_of(others).highest, noise_of_weights)
    counted = _has_gap(bench, others) & ~_has_gap(bench, shown)
    gains = np.where(counted, fits.row_losses(others) - fits.row_losses(shown), 0.0)
    noise_ratio = noise_of_weights / np.maximum(largest_noise, 1e-300)
    return float(gains @ noise_ratio**2), bench.search.threshold.of(term)


def _has_gap(bench: Bench, terms: frozenset[Term], *, in_highest_noise: bool = False) -> Bool[Array, " nv"]:
    """True for joints with a gap after a set of effects, in the estimated noise or in the highest possible noise."""
    judge = bench.residuals.judge_of(terms)
    noise = judge.highest if in_highest_noise else judge.floor
    return residual_sums_with(bench.plain, terms).rms() > contract_levels.FLOORS_LEFT * noise
