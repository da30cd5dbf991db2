"""Threshold that the gain of an effect must exceed, so that findings by chance are rare.

The gain of an effect is the decrease of the loss (weighted squared residual) on held-out data when the effect is added
to the fit. Residuals of recordings without a gap are simulated: they contain noise and changes of the model within its
tolerances, and nothing else. Every effect is fitted to each of them. A Gumbel distribution, the usual law of largest
values, is fitted to the largest gain in each recording.
"""

from __future__ import annotations

import numpy as np

from identification.diagnosis.columns.session import Series
from identification.diagnosis.fit.problem import Problem
from identification.diagnosis.noise.whitening import Whitening
from identification.diagnosis.search.search import Search, Threshold, joint_of, price
from identification.engine.chance import exceeded_by_chance
from identification.engine.fits.held_out_gains import gains_on_residuals
from identification.engine.products.row_products import RowProducts
from identification.gates import above_chance
from phantom_dyn.array_types import Array, Float
from phantom_dyn.random_streams import random_stream

# Number of simulated recordings: the error of the mean of their largest gains is a ninth of the gains' deviation.
_REPLICATES = 80


def null_threshold(search: Search, filters: Whitening, noise: Series, least: float = 0.0) -> Threshold:
    """Held-out gain that no effect of the catalogue reaches by chance in 99 of 100 recordings without a gap.

    The residual of a recording without a gap is simulated as the sum of two parts. One is the noise of the recording:
    the part of its residual that no model predicts. Each block of it gets a random sign, which preserves spectrum, size
    and correlation between joints. The other part comes from changes of the modelled inertias and friction, drawn from
    their tolerances. The threshold is a quantile of the Gumbel distribution with the mean and the deviation of the
    largest gains. Thresholds of single joints are computed in the same way from the effects of each joint. They are
    quantiles of a higher level, so that chance exceeds any of them in at most one recording of 100.

    Args:
        search: Candidate effects and fitting problem.
        filters: Filters that make the columns of the problem white.
        noise: Part of the residual of each log that no model predicts, whitened.
        least: Lower bound of each threshold.
    """
    problem = search.problem
    if not search.terms:
        return Threshold(least, {})
    rng = random_stream("recordings without a gap")
    b, core_b = _null_products(problem, filters, noise, rng)
    # The price of an effect's parameters beyond the first one is subtracted from its gain.
    extra = np.array([max(price(search.counts[term]) - above_chance.PARAMETER_PRICE, 0.0) for term in search.terms])
    gains = gains_on_residuals(problem, [term.columns for term in search.terms], b, core_b) - extra[:, None]
    joints = list(dict.fromkeys(joint_of(term) for term in search.terms))
    of_joint = {joint: [k for k, term in enumerate(search.terms) if joint_of(term) == joint] for joint in joints}
    wrong = (1.0 - above_chance.CLAIM_LEVEL) / len(joints)
    return Threshold(
        max(exceeded_by_chance(gains.max(axis=0), 1.0 - above_chance.CLAIM_LEVEL), least),
        {joint: max(exceeded_by_chance(gains[own].max(axis=0), wrong), least) for joint, own in of_joint.items()},
    )


def _null_products(
    problem: Problem, filters: Whitening, noise: Series, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Products (sums over samples) of each whitened column with each of ``R`` simulated residuals.

    Returns:
        Products over the blocks of each fold, and products over the cores of these blocks. The core of a block is the
        part whose noise is independent of the block before. The shape of both is ``(F, K, R)``, for ``F`` folds and
        ``K`` columns.
    """
    columns, blocks, grams = problem.columns, problem.blocks, problem.grams
    folds, total = int(grams.fold.max()) + 1, len(columns.names)
    signs = rng.choice([-1.0, 1.0], size=(len(blocks), _REPLICATES))
    sigma = np.array([n.sigma for n in columns.tolerance_parameters])
    bound = np.array([n.bound for n in columns.tolerance_parameters])
    # Random changes of the tolerance parameters, within their bounds.
    changes = np.clip(rng.normal(size=(len(sigma), _REPLICATES)) * sigma[:, None], -bound[:, None], bound[:, None])
    # Products of the columns with the noise of each block. Each simulated recording adds them with random signs.
    whole, core = np.zeros((len(blocks), total)), np.zeros((len(blocks), total))
    for j, row in enumerate(grams.rows):
        weight = problem.weights.per_sample[j]
        for k, block in enumerate(blocks):
            if grams.fold[k] < 0:
                continue
            part = slice(block.start, block.stop)
            use = problem.white.usable[block.log][part, j]
            e = weight * np.where(use, noise[block.log][part, j], 0.0)
            guard = block.core - block.start  # number of samples before the core
            x = columns.values[block.log][j]
            in_core = _product(filters, x, e[guard:], block.log, j, block.core)
            before_core = _product(filters, x, e[:guard], block.log, j, block.start) if guard else 0.0
            core[k, row.index] += in_core
            whole[k, row.index] += in_core + before_core

    def by_fold(of_noise: Float[Array, "B K"], of_columns: RowProducts) -> Float[Array, "F K R"]:
        """Products of each fold with the simulated residuals: those with the noise plus those with model changes."""
        blocks_of_fold = [grams.fold == fold for fold in range(folds)]
        of_changes = of_columns.between(np.arange(len(sigma)), np.arange(total)).transpose(0, 2, 1) @ changes
        return np.array([of_noise[rows].T @ signs[rows] for rows in blocks_of_fold]) + of_changes

    return by_fold(whole, grams.fold_a), by_fold(core, grams.fold_core_a)


def _product(
    filters: Whitening, x: Float[Array, "n k"], e: Float[Array, " m"], log: int, row: int, start: int
) -> Float[Array, " k"]:
    """Products of whitened columns with a series. To save time, the series is filtered instead of the many columns."""
    series, first = filters.transposed(e, log, row, start)
    return series @ x[first : first + len(series)]
