"""The shortest formula that predicts a residual on held-out blocks, and how often bootstrap replicates choose it.

A formula is a sum of terms of the library times coefficients. Nuisances are the changes of the model within its
tolerances and the sizes of the findings; they are fitted together with every formula.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from identification.diagnosis.law.joint_residual import JointResidual
from identification.diagnosis.law.library import LibraryTerm, library
from identification.engine.chance import shuffled_pieces
from identification.engine.numerics.bounded import bounded_solve
from identification.engine.products.block_products import BlockProducts, NuisancePrior, SummedProducts, block_products
from identification.engine.resampling import REPEATED_CHOICES, block_counts
from identification.engine.search.stepwise import Chosen, Terms, extended, gains, residual_squares, stepwise
from identification.gates import above_chance
from phantom_dyn.array_types import Array, Float
from phantom_dyn.random_streams import random_stream

MOST_TERMS = 4  # largest number of terms of a formula, so that a reader can check it term by term
_AT_ONCE = 24  # number of columns at the full rate that are filtered in one call
_MOST_ROUNDS = 4  # largest number of rounds in which nuisances at a bound are held there, and others released
_PERMUTATIONS = 100  # number of permutations of the blocks: the smallest that has a 99 % quantile
STABLE = 0.6  # share of the bootstrap replicates that have to choose the kinds of terms of a formula; else it is no law
NEARLY = 0.85  # a shorter formula has to predict this share of the squares that the best size predicts
_WORTH = 0.02  # further terms have to add this share of the predicted squares; else the shorter formula is taken


@dataclass(frozen=True)
class LibraryColumns:
    """Columns of the library for one joint's residual.

    Attributes:
        library: The terms.
        x: Their columns in the judged band at the kept samples, scaled to unit size, then the nuisance columns, ``(n,
            C)``.
        size: Root mean square of each column of a term, by which the column is divided, ``(D,)``.
        terms: Indices of the columns of each term.
        products: Products of the columns, by block.
        prior: Prior on the coefficients of the nuisance columns (tolerance parameters of the model, and findings).
    """

    library: tuple[LibraryTerm, ...]
    x: Float[Array, "n C"]
    size: Float[Array, " D"]
    terms: Terms
    products: BlockProducts
    prior: NuisancePrior

    @property
    def nuisances(self) -> list[int]:
        """Indices of the nuisance columns."""
        return list(range(len(self.size), self.x.shape[1]))

    def texts(self, chosen: Chosen) -> dict[int, tuple[str, LibraryTerm]]:
        """For each column of some terms, its text in a formula and its term."""
        out = {}
        for k in chosen:
            term = self.library[k]
            for column, text in zip((self.terms.first[k], self.terms.second[k]), term.texts, strict=False):
                out[int(column)] = (text, term)
        return out

    def inputs(self, chosen: Chosen) -> frozenset[str]:
        """Names of the inputs of some terms."""
        return frozenset().union(*(self.library[k].inputs for k in chosen))


@dataclass(frozen=True)
class Choice:
    """The chosen formula.

    Attributes:
        columns: Columns of the library.
        chosen: Terms of the formula, empty if no formula gains more than chance.
        held_out: Squared residual of each block with formulas that were chosen and fitted on other folds, ``(B,)``.
        before: Squared residual of each block without a law, ``(B,)``.
        votes: Share of the bootstrap replicates that choose each kind of term.
        same_kinds: Share of the replicates that choose the same kinds of terms as the formula.
        input_votes: Share of the replicates whose choice depends on each input.
    """

    columns: LibraryColumns
    chosen: Chosen
    held_out: Float[Array, " B"]
    before: Float[Array, " B"]
    votes: dict[str, float]
    same_kinds: float
    input_votes: dict[str, float]


def columns_of(residual: JointResidual, *, memory: bool = True) -> LibraryColumns:
    """The library's columns and their products for one residual, with or without linear responses with memory."""
    terms = library(residual, memory=memory)
    series = [column for term in terms for column in term.columns]
    parts = []
    for log in residual.logs:
        # All columns of a long recording at the full rate would fill the memory.
        pieces = [series[k : k + _AT_ONCE] for k in range(0, len(series), _AT_ONCE)]
        bands = [log.in_band(np.column_stack([column(log) for column in piece])) for piece in pieces]
        parts.append(np.column_stack(bands))
    x = np.concatenate(parts)
    weight = residual.weight
    size = np.sqrt((x**2 * weight[:, None]).sum(axis=0) / max(weight.sum(), 1e-12))
    size = np.where(size > 1e-12, size, np.inf)
    starts = np.cumsum([0, *(len(term.columns) for term in terms)])
    first, second = starts[:-1], starts[1:] - 1
    x = np.column_stack([x / size, residual.nuisances])
    products = block_products(x, residual.y, weight, residual.blocks, len(residual.folds))
    return LibraryColumns(terms, x, size, Terms(first, second), products, residual.prior)


def with_nuisances_at_bounds(residual: JointResidual, columns: LibraryColumns) -> tuple[JointResidual, LibraryColumns]:
    """Residual and columns with a prior that holds some nuisances at their bounds: those at a bound in the best fit.

    The other nuisances are free within their prior. So every later fit is one linear solution without bounds. If a
    chosen term makes the same torque as a held nuisance, the nuisance may be inside its bounds in the next round, and
    is released. If rounds repeat, the nuisance stays held, and the term explains the torque beyond the bound.
    """
    whole = columns.products.summed((residual.folds >= 0).astype(float))
    squared = np.diag(whole.gram)[len(columns.size) :]
    prior, held, earlier = residual.prior, np.zeros(residual.prior.count), []
    for _ in range(_MOST_ROUNDS):
        path = [(), *stepwise(columns.terms, prior.eliminate_from(whole), MOST_TERMS)]
        size = best_size(held_out_losses(residual, replace(columns, prior=prior), MOST_TERMS))
        at = columns.terms.columns(path[min(size, len(path) - 1)])
        nuisances = _fitted_within_bounds(residual, columns, whole, at)[len(at) :]
        now = np.where(nuisances <= residual.lower, -1.0, 0.0) + np.where(nuisances >= residual.upper, 1.0, 0.0)
        if (now == held).all():
            break
        repeats = any((now == other).all() for other in earlier)
        earlier.append(held)
        held = np.where(now != 0.0, now, held) if repeats else now
        prior = _prior_holding(residual, held, squared)
        if repeats:
            break
    return replace(residual, prior=prior), replace(columns, prior=prior)


def _prior_holding(residual: JointResidual, held: Float[Array, " F"], squared: Float[Array, " F"]) -> NuisancePrior:
    """The prior that holds some nuisances: its standard deviation at their bound is so small that no fit changes them.

    Args:
        residual: Residual of the joint, with prior and bounds.
        held: For each nuisance -1 or 1 where it is held at its lower or upper bound, else 0.
        squared: Sum of squares of each nuisance column.
    """
    narrow = np.where(held != 0.0, 1e6 * np.maximum(squared, 1e-12), 0.0)
    bound = np.where(held < 0.0, residual.lower, np.where(held > 0.0, residual.upper, 0.0))
    return NuisancePrior(residual.prior.precision + np.diag(narrow), residual.prior.right + narrow * bound)


def _fitted_within_bounds(
    residual: JointResidual, columns: LibraryColumns, products: SummedProducts, at: list[int]
) -> Float[Array, " k"]:
    """Coefficients of some columns of terms, followed by those of the nuisance columns within their bounds."""
    every = [*at, *columns.nuisances]
    a, b = products.gram[np.ix_(every, every)].copy(), products.right[every].copy()
    own = slice(len(at), None)
    a[own, own] += residual.prior.precision
    a[np.diag_indices_from(a)] *= 1.0 + 1e-9
    b[own] += residual.prior.right
    none = np.full(len(at), np.inf)
    return bounded_solve(a, b, np.concatenate([-none, residual.lower]), np.concatenate([none, residual.upper]))


def losses_without_law(residual: JointResidual, columns: LibraryColumns) -> Float[Array, " B"]:
    """Squared residual of each block without a law: the nuisance columns alone, fitted to other folds within bounds."""
    loss = np.zeros(len(residual.folds))
    for train, held_out in columns.products.by_fold(residual.folds):
        theta = _fitted_within_bounds(residual, columns, train, [])
        for k in held_out:
            loss[k] = columns.products.block(k).left(columns.nuisances, theta)
    return loss


def search_formula(residual: JointResidual, columns: LibraryColumns, before: Float[Array, " B"]) -> Choice:
    """The formula with the number of terms that predicts held-out blocks best, tested against chance and by bootstrap.

    If bootstrap replicates disagree on this formula, a shorter one on which they agree replaces it, provided that it
    predicts nearly as much.

    Args:
        residual: Residual of the joint.
        columns: Columns of the library.
        before: Squared residual of each block without a law.
    """
    loss = held_out_losses(residual, columns, MOST_TERMS)
    loss[0] = before
    whole = columns.products.summed_without((residual.folds >= 0).astype(float), columns.prior)
    path = [(), *stepwise(columns.terms, whole, MOST_TERMS)]
    size = min(best_size(loss), len(path) - 1)
    while size > 0 and not _beyond_chance(residual, columns, path[size]):
        size -= 1
    longest = Choice(columns, path[size], loss[size], loss[0], *_votes_of_replicates(residual, columns, path[size]))
    gained = loss[0].sum() - loss[size].sum()
    for shorter in range(size, 0, -1):
        if loss[0].sum() - loss[shorter].sum() < NEARLY * gained:
            break
        votes = _votes_of_replicates(residual, columns, path[shorter])
        _, same, _ = votes
        if same >= STABLE and _beyond_chance(residual, columns, path[shorter]):
            return Choice(columns, path[shorter], loss[shorter], loss[0], *votes)
    return longest


def held_out_losses(
    residual: JointResidual, columns: LibraryColumns, most: int, start: Chosen = ()
) -> Float[Array, "m B"]:
    """Squared residual of each block at every size from 0 terms on, with terms chosen on the other folds.

    Args:
        residual: Residual of the joint.
        columns: Columns of the library.
        most: Largest number of terms beside those of ``start``.
        start: Terms that every choice contains.
    """
    terms, products, folds, prior = columns.terms, columns.products, residual.folds, columns.prior
    loss = np.zeros((most + 1, len(folds)))
    for train, held_out in products.by_fold(folds):
        reduced = prior.eliminate_from(train)
        path = extended(terms, reduced, start, most)
        for size in range(most + 1):
            at = terms.columns(path[min(size, len(path) - 1)])
            theta = reduced.fitted(at)
            theta = np.concatenate([theta, prior.fitted_with(train, at, theta)])
            for k in held_out:
                loss[size, k] = products.block(k).left([*at, *columns.nuisances], theta)
    return loss


def best_size(loss: Float[Array, "m B"]) -> int:
    """The smallest number of terms whose loss is nearly the smallest one.

    It may exceed the smallest loss by its standard error over blocks, or by a share `_WORTH` of the gain of all terms.
    """
    total = loss.sum(axis=1)
    best = int(np.argmin(total))
    most = _WORTH * (total[0] - total[best])
    for size in range(best):
        more = loss[size] - loss[best]
        error = np.sqrt(len(more)) * more.std()
        if more.sum() <= max(error, most):
            return size
    return best


def _beyond_chance(residual: JointResidual, columns: LibraryColumns, chosen: Chosen) -> bool:
    """True if every term gains more than the best term of the library gains by chance on the formula's residual."""
    terms, seen = columns.terms, (residual.folds >= 0).astype(float)
    whole = columns.products.summed_without(seen, columns.prior)
    at = terms.columns(chosen)
    with_all = residual_squares(terms, whole, chosen)
    without_each = [residual_squares(terms, whole, chosen[:k] + chosen[k + 1 :]) for k in range(len(chosen))]
    least_gain = min(without_each) - with_all
    theta = whole.fitted(at)
    nuisances = columns.prior.fitted_with(columns.products.summed(seen), at, theta)
    model = columns.x[:, at] @ theta + columns.x[:, len(columns.size) :] @ nuisances
    return least_gain > gain_by_chance(residual, columns, residual.y - model)


def gain_by_chance(residual: JointResidual, columns: LibraryColumns, remaining: Float[Array, " n"]) -> float:
    """Gain that the best of all terms reaches by chance, from residuals with permuted blocks.

    Args:
        residual: Residual of the joint.
        columns: Columns of the library.
        remaining: Residual of each kept sample after the formula.
    """
    rng = random_stream("order of blocks of a rest")
    used = residual.weight > 0
    root = np.sqrt(residual.weight[used])
    x, numbers = columns.x[used] * root[:, None], residual.blocks[used]
    pieces = [remaining[used][numbers == k] * root[numbers == k] for k in np.unique(numbers)]
    gram = x.T @ x
    prior = replace(columns.prior, right=np.zeros(columns.prior.count))
    out = []
    for _ in range(_PERMUTATIONS):
        mixed = shuffled_pieces(pieces, rng)
        products = prior.eliminate_from(SummedProducts(gram, mixed @ x, float(mixed @ mixed)))
        out.append(gains(columns.terms, products, ()).max())
    return float(np.quantile(out, above_chance.CLAIM_LEVEL))


def _votes_of_replicates(
    residual: JointResidual, columns: LibraryColumns, chosen: Chosen
) -> tuple[dict[str, float], float, dict[str, float]]:
    """Shares of the bootstrap replicates over blocks that agree with each choice of a formula.

    Returns:
        The share that chooses each kind of term, the share that chooses exactly the kinds of the terms ``chosen``, and
        the share whose choice depends on each input.
    """
    if not chosen:
        return {}, 0.0, {}
    seen = residual.folds >= 0
    kinds, inputs, same = Counter(), Counter(), 0
    wanted = Counter(columns.library[k].kind for k in chosen)
    for drawn in block_counts(int(seen.sum()), random_stream("blocks of a law"), REPEATED_CHOICES):
        counts = np.zeros(len(seen))
        counts[seen] = drawn
        # A replicate of blocks without samples chooses no term.
        found = extended(columns.terms, columns.products.summed_without(counts, columns.prior), (), len(chosen))[-1]
        chosen_kinds = Counter(columns.library[k].kind for k in found)
        same += chosen_kinds == wanted
        kinds.update(set(chosen_kinds))
        inputs.update(columns.inputs(found))
    share = 1.0 / REPEATED_CHOICES
    return (
        {kind: share * n for kind, n in kinds.items()},
        share * same,
        {name: share * n for name, n in inputs.items()},
    )
