"""What chance gives: the largest gain over the whole catalogue on robots whose only gap is tolerance and noise."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from identification.diagnosis.bounded import solve
from identification.diagnosis.problem import Problem
from identification.diagnosis.search import PARAMETER_PRICE, Search, price

Array = np.ndarray

_REPLICATES = 80
_LEVEL = 0.99
_EULER = 0.5772156649


def null_threshold(search: Search, noise: tuple[Float[Array, "n nv"], ...]) -> float:
    """Held-out gain that no effect of the catalogue reaches by chance in 99 of 100 recordings without a gap.

    Recordings without a gap are made from this one: the unpredictable part of its residual with the sign of whole
    blocks drawn anew (which keeps colour, size and the correlation between joints), plus moves of the modelled
    inertias and friction drawn from their tolerances. All rivals are fitted to each, and the largest gain is kept; the
    quantile is that of a Gumbel law with the mean and deviation of these maxima.

    Args:
        search: Rivals and problem.
        noise: Unpredicted residual of each log, white.
    """
    problem = search.problem
    if not search.terms:
        return 0.0
    rng = np.random.default_rng(20260102)
    b, core_b, core_c = _null_products(problem, noise, rng)
    base = _losses(problem, np.arange(problem.nuisances), b, core_b, core_c)
    best = np.full(_REPLICATES, -np.inf)
    for term in search.terms:
        active = np.array([*range(problem.nuisances), *sorted(term.columns)])
        gain = base - _losses(problem, active, b, core_b, core_c)
        best = np.maximum(best, gain - max(price(search.sizes[term]) - PARAMETER_PRICE, 0.0))
    spread = best.std() * np.sqrt(6) / np.pi
    return float(best.mean() - _EULER * spread - spread * np.log(-np.log(_LEVEL)))


def _null_products(
    problem: Problem, noise: tuple[Float[Array, "n nv"], ...], rng: np.random.Generator
) -> tuple[Array, Array, Array]:
    """Products of all columns with null residuals: ``(B, K, R)`` whole and core, ``(B, R)`` squares."""
    columns, blocks, grams = problem.white, problem.blocks, problem.grams
    count, total = len(blocks), len(columns.names)
    b, core_b = np.zeros((count, total, _REPLICATES)), np.zeros((count, total, _REPLICATES))
    core_c = np.zeros((count, _REPLICATES))
    signs = rng.choice([-1.0, 1.0], size=(count, _REPLICATES))
    sigma = np.array([n.sigma for n in columns.nuisances])
    bound = np.array([n.bound for n in columns.nuisances])
    moves = np.clip(rng.normal(size=(len(sigma), _REPLICATES)) * sigma[:, None], -bound[:, None], bound[:, None])
    for j, row in enumerate(grams.rows):
        weight = problem.weights.per_sample[j]
        index = row.index
        for k, block in enumerate(blocks):
            part = slice(block.start, block.stop)
            use = columns.usable[block.log][part, j]
            x, e = columns.values[block.log][j][part][use], noise[block.log][part, j][use]
            inside = np.flatnonzero(use) >= block.core - block.start
            b[k][index] += weight * np.outer(x.T @ e, signs[k])
            core_b[k][index] += weight * np.outer(x[inside].T @ e[inside], signs[k])
            core_c[k] += weight * float(e[inside] @ e[inside])
    nuisance = np.arange(len(sigma))
    for k in range(count):
        core_c[k] += 2 * np.einsum("ir,ir->r", core_b[k][nuisance], moves)
        core_c[k] += np.einsum("ir,ij,jr->r", moves, grams.core_a[k][np.ix_(nuisance, nuisance)], moves)
        b[k] += grams.a[k][:, nuisance] @ moves
        core_b[k] += grams.core_a[k][:, nuisance] @ moves
    return b, core_b, core_c


def _losses(problem: Problem, active: Array, b: Array, core_b: Array, core_c: Array) -> Float[Array, " R"]:
    """Held-out loss and penalty of each null recording with the active columns; bounds are left out."""
    grams = problem.grams
    grid = np.ix_(active, active)
    prior = np.diag(problem.precision[active])
    train = grams.fold >= 0
    a = problem.total_a[grid] + prior
    right = b[train][:, active].sum(axis=0)
    whole = solve(a, right)
    nuisances = np.arange(problem.nuisances)
    loss = (whole[nuisances] ** 2 * problem.precision[nuisances][:, None]).sum(axis=0)
    for fold in range(int(grams.fold.max()) + 1):
        mine = grams.fold == fold
        block_a = grams.a[mine][:, *grid].sum(axis=0)
        x = solve(a - block_a, right - b[mine][:, active].sum(axis=0))
        core_a = grams.core_a[mine][:, *grid].sum(axis=0)
        loss += core_c[mine].sum(axis=0)
        loss += (x * (core_a @ x - 2 * core_b[mine][:, active].sum(axis=0))).sum(axis=0)
    return loss
