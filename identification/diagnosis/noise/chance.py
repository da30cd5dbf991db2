"""Maximum statistic over the catalogue: the largest gain by chance, with a Gumbel fit, on robots without a gap.

The null recordings differ from the given model by its tolerances and by noise only.
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

# Recordings without a gap: the mean of their largest gains is then known to a ninth of their deviation.
_REPLICATES = 80


def null_threshold(search: Search, filters: Whitening, noise: Series, least: float = 0.0) -> Threshold:
    """Held-out gain that no effect of the catalogue reaches by chance in 99 of 100 recordings without a gap.

    Recordings without a gap are made from this one: the unpredictable part of its residual with a random sign for each
    block (which keeps colour, size and the correlation between joints), plus changes of the modelled inertias and
    friction drawn from their tolerances. All rivals are fitted to each, and the largest gain is kept; the quantile is
    that of a Gumbel law with the mean and deviation of these maxima. The thresholds of single joints are computed in
    the same way over the effects of each joint, so that together they are exceeded in one recording of 100.

    Args:
        search: Rivals and problem.
        filters: Filters that make the columns of the problem white.
        noise: Unpredicted residual of each log, whitened.
        least: Lower bound of each threshold.
    """
    problem = search.problem
    if not search.terms:
        return Threshold(least, {})
    rng = random_stream("recordings without a gap")
    b, core_b = _null_products(problem, filters, noise, rng)
    extra = np.array([max(price(search.sizes[term]) - above_chance.PARAMETER_PRICE, 0.0) for term in search.terms])
    gains = gains_on_residuals(problem, [term.columns for term in search.terms], b, core_b) - extra[:, None]
    joints = list(dict.fromkeys(joint_of(term) for term in search.terms))
    alike = {joint: [k for k, term in enumerate(search.terms) if joint_of(term) == joint] for joint in joints}
    wrong = (1.0 - above_chance.CLAIM_LEVEL) / len(joints)
    return Threshold(
        max(exceeded_by_chance(gains.max(axis=0), 1.0 - above_chance.CLAIM_LEVEL), least),
        {joint: max(exceeded_by_chance(gains[own].max(axis=0), wrong), least) for joint, own in alike.items()},
    )


def _null_products(
    problem: Problem, filters: Whitening, noise: Series, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Products of all white columns with null residuals, ``(F, K, R)``, over whole blocks of each fold and cores."""
    columns, blocks, grams = problem.columns, problem.blocks, problem.grams
    folds, total = int(grams.fold.max()) + 1, len(columns.names)
    signs = rng.choice([-1.0, 1.0], size=(len(blocks), _REPLICATES))
    sigma = np.array([n.sigma for n in columns.tolerance_parameters])
    bound = np.array([n.bound for n in columns.tolerance_parameters])
    changes = np.clip(rng.normal(size=(len(sigma), _REPLICATES)) * sigma[:, None], -bound[:, None], bound[:, None])
    # Products of the columns with the noise of each block; those of a recording are their sums with signs.
    whole, core = np.zeros((len(blocks), total)), np.zeros((len(blocks), total))
    for j, row in enumerate(grams.rows):
        weight = problem.weights.per_sample[j]
        for k, block in enumerate(blocks):
            if grams.fold[k] < 0:
                continue
            part = slice(block.start, block.stop)
            use = problem.white.usable[block.log][part, j]
            e = weight * np.where(use, noise[block.log][part, j], 0.0)
            first = block.core - block.start
            x = columns.values[block.log][j]
            inside = _product(filters, x, e[first:], block.log, j, block.core)
            edge = _product(filters, x, e[:first], block.log, j, block.start) if first else 0.0
            core[k, row.index] += inside
            whole[k, row.index] += inside + edge

    def by_fold(of_noise: Float[Array, "B K"], of_columns: RowProducts) -> Float[Array, "F K R"]:
        own = [grams.fold == fold for fold in range(folds)]
        of_changes = of_columns.between(np.arange(len(sigma)), np.arange(total)).transpose(0, 2, 1) @ changes
        return np.array([of_noise[rows].T @ signs[rows] for rows in own]) + of_changes

    return by_fold(whole, grams.fold_a), by_fold(core, grams.fold_core_a)


def _product(
    filters: Whitening, x: Float[Array, "n k"], e: Float[Array, " m"], log: int, row: int, start: int
) -> Float[Array, " k"]:
    """Product of white columns with a series: the series is filtered instead of the columns, which are many."""
    series, first = filters.transposed(e, log, row, start)
    return series @ x[first : first + len(series)]
