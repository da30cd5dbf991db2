"""Fits of many sets of effects that differ little: each from the nearest one that was solved as a whole.

A fit of a robot with many joints contains some hundred moves of its model, and hardly any of them changes its bound
where one effect takes the place of another. So a few sets are kept as tableaus (see `numerics.tableau`), and every
other set costs what it changes of the nearest one: same minima, to rounding.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from identification.diagnosis.fit.fitting import Fitted, Point
from identification.diagnosis.fit.problem import Problem
from identification.diagnosis.fit.projection import gains_within
from identification.diagnosis.numerics.tableau import Entering, Tableau, tableau
from identification.diagnosis.numerics.tableau_changes import Settled, answers_among, changed
from phantom_dyn._kernels.jit import fused
from phantom_dyn.array_types import Bool, Float, Int

Array = np.ndarray

# Columns and bounds in which a set may differ from the solved one that it is computed from.
_FAR = 60
# Solved sets that are kept, and fits of which it is known where they ended.
_KEPT = 4
_ENDS = 100
# Share of a move's largest possible part of a loss below which it is rounding.
_NOTHING = 1e-14


@dataclass(frozen=True)
class _Pieces:
    """What one column enters a tableau with, for several tableaus: see `Entering`."""

    cross: Float[Array, "T n"]
    answer: Float[Array, "T n"]
    slope: Float[Array, " T"]
    scale: Float[Array, " T"]


@dataclass(frozen=True)
class _Solved:
    """One set of columns, solved on all blocks and once without each fold.

    Attributes:
        problem: What is fitted.
        columns: Of the set, ``(n,)``.
        whole: Its fit.
    """

    problem: Problem
    columns: Int[Array, " n"]
    whole: Tableau
    _entering: dict[int, _Pieces] = field(default_factory=dict)
    _fold_entering: dict[int, _Pieces] = field(default_factory=dict)
    _core_lines: dict[int, Float[Array, "B n"]] = field(default_factory=dict)

    @cached_property
    def inside(self) -> Bool[Array, " K"]:
        """Which of all columns are in the set."""
        return _marked(self.columns, len(self.problem.precision))

    @cached_property
    def folds(self) -> tuple[Tableau, ...]:
        """The fits that have not seen one fold each."""
        problem, columns = self.problem, self.columns
        a, b, lower, upper = _quadratic(problem, columns)
        near = self.whole.x * self.whole.scale
        less_a, less_b = problem.grams.fold_a.among(columns), problem.grams.by_fold(problem.grams.b[:, columns])
        return tuple(tableau(a - x, b - y, lower, upper, near) for x, y in zip(less_a, less_b, strict=True))

    @cached_property
    def core(self) -> Float[Array, "B n n"]:
        """Products over the core of each block."""
        return self.problem.grams.core_a.among(self.columns)

    @cached_property
    def which(self) -> Int[Array, " B"]:
        """The fit that each block is judged by: its fold's, or the last, which is that of all blocks."""
        fold = self.problem.grams.fold
        return np.where(fold < 0, len(self.folds), fold)

    @cached_property
    def at(self) -> Float[Array, "B n"]:
        """Coefficients that each block is judged by."""
        return np.stack([one.x * one.scale for one in (*self.folds, self.whole)])[self.which]

    @cached_property
    def core_slope(self) -> Float[Array, "B n"]:
        """Half the slope of each block's loss there."""
        return (self.core @ self.at[:, :, None])[:, :, 0] - self.problem.grams.core_b[:, self.columns]

    @cached_property
    def core_diagonal(self) -> Float[Array, " n"]:
        """Products of each column with itself over all cores."""
        return np.einsum("bkk->k", self.core)

    @cached_property
    def losses(self) -> Float[Array, " B"]:
        """Loss of each block there."""
        grams = self.problem.grams
        return grams.core_c + np.einsum("bk,bk->b", self.core_slope - grams.core_b[:, self.columns], self.at)

    @cached_property
    def held(self) -> Bool[Array, " K"]:
        """Which of all columns are in the set and at a bound."""
        return _marked(self.columns[self.whole.held], len(self.problem.precision))

    def apart(self, wanted: Bool[Array, " K"], end: _End | None) -> int:
        """Number of columns that only one of two sets has, or that are at a bound in only one of them.

        Args:
            wanted: The columns of the set.
            end: Where the fit of a similar set ended; None: where this one did.
        """
        other = self.inside != wanted
        if end is not None:
            other = other | (self.inside & wanted & end.known & (self.held != end.held))
        return int(np.count_nonzero(other))

    def entering(self, columns: Int[Array, " m"]) -> Entering:
        """Columns that are not in the set, as they enter its fit."""
        problem = self.problem
        square = problem.total_a[np.ix_(columns, columns)] + np.diag(problem.precision[columns])
        return self.whole.joined(*self.pieces(columns), square)

    def pieces(self, columns: Int[Array, " m"]) -> tuple[Array, Array, Array, Array]:
        """The same without the products among them: see `Tableau.pieces`."""
        known = self._entering
        new = np.array([k for k in columns.tolist() if k not in known], dtype=int)
        if len(new):
            problem = self.problem
            diagonal = np.diag(problem.total_a)[new] + problem.precision[new]
            parts = self.whole.pieces(problem.total_a[np.ix_(new, self.columns)], diagonal, problem.total_b[new])
            known.update((column, _Pieces(*(part[k][None] for part in parts))) for k, column in enumerate(new.tolist()))
        return _together(self.whole, [known[k] for k in columns.tolist()], 0)

    def fold_entering(self, columns: Int[Array, " m"]) -> list[Entering]:
        """The same for the fit without each fold."""
        problem, known = self.problem, self._fold_entering
        new = np.array([k for k in columns.tolist() if k not in known], dtype=int)
        whole = problem.total_a[np.ix_(columns, columns)] + np.diag(problem.precision[columns])
        squares = whole - problem.grams.fold_a.among(columns)
        if len(new):
            cross = problem.total_a[np.ix_(new, self.columns)] - problem.grams.fold_a.between(new, self.columns)
            b = problem.total_b[new] - problem.grams.by_fold(problem.grams.b[:, new])
            diagonal = np.diag(problem.total_a)[new] + problem.precision[new] - problem.grams.fold_a.diagonal(new)
            parts = [one.pieces(cross[fold], diagonal[fold], b[fold]) for fold, one in enumerate(self.folds)]
            for k, column in enumerate(new.tolist()):
                known[column] = _Pieces(*(np.array([part[i][k] for part in parts]) for i in range(4)))
        pieces = [known[k] for k in columns.tolist()]
        return [one.joined(*_together(one, pieces, k), squares[k]) for k, one in enumerate(self.folds)]

    def core_lines(self, columns: Int[Array, " m"]) -> Float[Array, "B m n"]:
        """Products of further columns with those of the set over the core of each block."""
        new = np.array([k for k in columns.tolist() if k not in self._core_lines], dtype=int)
        if len(new):
            lines = self.problem.grams.core_a.between(new, self.columns)
            self._core_lines.update((column, lines[:, k]) for k, column in enumerate(new.tolist()))
        shape = len(self.problem.grams.fold), 0, len(self.columns)
        return np.stack([self._core_lines[k] for k in columns.tolist()], axis=1) if len(columns) else np.zeros(shape)


@dataclass(frozen=True)
class _End:
    """Where the fits of one set ended.

    Attributes:
        bits: Of a number, those of the columns of the set.
        index: The columns that ``x`` is of, ``(v,)``.
        x: Coefficients without each fold, if the set was held out, and last those of the fit to all blocks, ``(G, v)``.
        known: Which of all columns ``x`` is of, ``(K,)``.
        held: Those of them that are at a bound in the fit to all blocks, ``(K,)``.
    """

    bits: int
    index: Int[Array, " v"]
    x: Float[Array, "G v"]
    known: Bool[Array, " K"]
    held: Bool[Array, " K"]


class NearFits:
    """Fits of sets of effects that are linear in all their coefficients, each from the nearest solved set.

    Args:
        problem: What is fitted.
        start: Coefficients from which a set is solved as a whole, NaN where there are none, ``(K,)``.
    """

    def __init__(self, problem: Problem, start: Float[Array, " K"]):
        self.problem = problem
        self._start = start
        self._solved: list[_Solved] = []
        # Where the last fits ended: a similar one hardly differs.
        self._ends, self._held_out_ends = deque[_End](maxlen=_ENDS), deque[_End](maxlen=_ENDS)
        self._nothing = float(problem.grams.c[problem.grams.fold >= 0].sum())

    def fit(self, active: Int[Array, " k"], *, held_out: bool) -> Fitted:
        """Fit of some columns, as `fitting.fit`."""
        problem, solved = self.problem, self._nearest(active)
        found = self._minima(solved, active, held_out=held_out)
        if not all(one.settled for one in found):
            # Rounding of what is far from it is too large.
            solved = self._solve(active)
            found = self._minima(solved, active, held_out=held_out)
        new, gone, index = _changes(solved, active)
        x = np.array([one.x for one in found])
        at_bound = (x[-1] <= problem.lower[index]) | (x[-1] >= problem.upper[index])
        count = len(problem.precision)
        self._keep(_End(self._bits(active), index, x, _marked(index, count), _marked(index[at_bound], count)))
        theta = np.zeros(len(problem.precision))
        theta[index] = x[-1]
        moves = slice(0, problem.nuisances)
        penalty = float(theta[moves] ** 2 @ problem.precision[moves])
        objective = self._nothing + found[-1].value
        loss, fold_active = np.zeros(0), np.zeros((0, len(active)))
        if held_out:
            loss = _losses(solved, new, x)
            kept = np.delete(np.arange(len(index)), gone)
            order = kept[np.argsort(index[kept])]
            fold_active = x[:-1, order]
        return Fitted(problem, Point(), theta, active, penalty, objective, loss, fold_active)

    def _minima(self, solved: _Solved, active: Int[Array, " k"], *, held_out: bool) -> list[Settled]:
        """Fits of some columns from a solved set: if they are held out without each fold first, and that of all."""
        new, gone, index = _changes(solved, active)
        bounds = self.problem.lower[index], self.problem.upper[index]
        tableaus = (*solved.folds, solved.whole) if held_out else (solved.whole,)
        entering = [*(solved.fold_entering(new) if held_out else ()), solved.entering(new)]
        near = np.full((len(tableaus), len(self.problem.precision)), np.nan)
        end = self._end_near(active, held_out=held_out)
        # Where nothing changes, the bounds that bind are known.
        if end is not None and len(new) + len(gone) > 0:
            near[:, end.index] = end.x[-len(near) :]
        parts = zip(tableaus, entering, near[:, index], strict=True)
        return [changed(one, more, gone, bounds, start) for one, more, start in parts]

    def _end_near(self, active: Int[Array, " k"], *, held_out: bool) -> _End | None:
        """Where the fit of the most similar set ended, the last one of those that are equally similar."""
        wanted = self._bits(active)
        ends = self._held_out_ends if held_out else self._ends
        return min(reversed(ends), key=lambda end: (end.bits ^ wanted).bit_count(), default=None)

    def _bits(self, active: Int[Array, " k"]) -> int:
        """A number with the bit of each column set."""
        return int.from_bytes(np.packbits(_marked(active, len(self.problem.precision))).tobytes())

    def _keep(self, end: _End) -> None:
        self._ends.append(end)
        if len(end.x) > 1:
            self._held_out_ends.append(end)

    def gains(self, active: Int[Array, " k"], sets: Iterable[tuple[int, ...]]) -> dict[tuple[int, ...], float]:
        """How much further columns lower the loss in sample, to second order, with those at a bound held there."""
        problem, solved = self.problem, self._nearest(active)
        (found,) = self._minima(solved, active, held_out=False)
        if not found.settled:
            solved = self._solve(active)
            (found,) = self._minima(solved, active, held_out=False)
        new, _, _ = _changes(solved, active)
        inside = frozenset(active.tolist())
        own = {columns: tuple(k for k in columns if k not in inside) for columns in sets}
        wanted = np.array(sorted({k for some in own.values() for k in some}), dtype=int)
        if not len(wanted):
            return dict.fromkeys(own, 0.0)
        beside = _Beside(solved, new, found, wanted)
        gains = dict.fromkeys(own, 0.0)
        for size in {len(some) for some in own.values()} - {0}:
            same = [columns for columns, some in own.items() if len(some) == size]
            columns = np.array([own[some] for some in same])
            depth = gains_within(*beside.left(columns), problem.lower[columns], problem.upper[columns])
            gains.update(zip(same, depth.tolist(), strict=True))
        return gains

    def _nearest(self, active: Int[Array, " k"]) -> _Solved:
        """The nearest solved set; a set that is far from all is solved as a whole."""
        wanted, end = _marked(active, len(self.problem.precision)), self._end_near(active, held_out=False)
        near = min(self._solved, key=lambda one: one.apart(wanted, end), default=None)
        if near is None or near.apart(wanted, end) > _FAR:
            return self._solve(active, near)
        self._solved = [*(one for one in self._solved if one is not near), near]
        return near

    def _solve(self, active: Int[Array, " k"], near: _Solved | None = None) -> _Solved:
        """A set solved as a whole, and kept: the one that was used last comes last."""
        start = self._start
        if near is not None:
            start = start.copy()
            start[near.columns] = near.whole.x * near.whole.scale
        solved = _Solved(self.problem, active, tableau(*_quadratic(self.problem, active), start[active]))
        self._solved = [*self._solved, solved][-_KEPT:]
        return solved


class _Beside:
    """Columns beside a fit, with the part taken out that its free columns can make of them.

    Args:
        solved: What the fit was computed from.
        new: Columns of the fit that are not in that set.
        found: The fit.
        wanted: The columns, in order.
    """

    def __init__(self, solved: _Solved, new: Int[Array, " m"], found: Settled, wanted: Int[Array, " w"]):
        self._wanted, self._problem, free = wanted, solved.problem, ~solved.whole.held
        cross, answer, slope, self._scale = solved.pieces(wanted)
        entered = solved.entering(new)
        n, k = len(solved.columns), len(found.flipped)
        places, action = found.action
        own = places < n
        across = self._problem.total_a[np.ix_(wanted, new)] * self._scale[:, None] * entered.scale
        across = across + cross[:, free] @ entered.answer[:, free].T
        # What the slopes of the wanted columns answer to what changes, and the other way round.
        there = np.empty((len(wanted), len(places)))
        there[:, own] = np.where(solved.whole.held[places[own]], 1.0, -1.0) * answer[:, places[own]]
        there[:, ~own] = across[:, places[~own] - n]
        back = np.empty((len(wanted), k))
        back[:, own[:k]] = answer[:, places[:k][own[:k]]]
        back[:, ~own[:k]] = across[:, places[:k][~own[:k]] - n]
        square = answers_among(solved.whole, entered, found.flipped)
        self._cross, self._answer, self._there = cross[:, free], answer[:, free], there[:, :k]
        self._made = np.linalg.solve(square, back.T).T
        self._slope = (slope + there @ action) / self._scale

    def left(self, columns: Int[Array, "g m"]) -> tuple[Float[Array, "g m m"], Float[Array, "g m"]]:
        """Products among each group of columns with priors, and with the residual, of what is left of them."""
        at, size = np.searchsorted(self._wanted, columns), columns.shape[1]
        square = self._problem.total_a[columns[:, :, None], columns[:, None, :]]
        square[:, np.arange(size), np.arange(size)] += self._problem.precision[columns]
        taken = self._cross[at] @ self._answer[at].transpose(0, 2, 1)
        taken = taken - self._there[at] @ self._made[at].transpose(0, 2, 1)
        scale = self._scale[at]
        return square + taken / (scale[:, :, None] * scale[:, None, :]), -self._slope[at]


def _marked(columns: Int[Array, " k"], count: int) -> Bool[Array, " K"]:
    """Which of all columns are among some."""
    out = np.zeros(count, dtype=bool)
    out[columns] = True
    return out


def _changes(solved: _Solved, active: Int[Array, " k"]) -> tuple[Int[Array, " m"], Int[Array, " l"], Int[Array, " v"]]:
    """Columns that enter a solved set, places of those that leave it, and all columns with those that enter last."""
    new = active[~solved.inside[active]]
    gone = np.flatnonzero(~_marked(active, len(solved.inside))[solved.columns])
    return new, gone, np.concatenate([solved.columns, new])


def _quadratic(problem: Problem, columns: Int[Array, " n"]) -> tuple[Array, Array, Array, Array]:
    """Products of some columns with priors, those with the residual, and bounds."""
    a = problem.total_a[np.ix_(columns, columns)]
    a.flat[:: len(a) + 1] += problem.precision[columns]
    return a, problem.total_b[columns], problem.lower[columns], problem.upper[columns]


def _together(one: Tableau, pieces: list[_Pieces], which: int) -> tuple[Array, Array, Array, Array]:
    """What several columns enter one of several tableaus with."""
    n = len(one.x)
    cross, answer = (
        np.array([getattr(piece, name)[which] for piece in pieces]).reshape(-1, n) for name in ("cross", "answer")
    )
    slope, scale = (np.array([getattr(piece, name)[which] for piece in pieces]) for name in ("slope", "scale"))
    return cross, answer, slope, scale


def _losses(solved: _Solved, new: Int[Array, " m"], x: Float[Array, "G v"]) -> Float[Array, " B"]:
    """Loss of the core of each block by the fit that has not seen it, from that of the solved set."""
    grams, n = solved.problem.grams, len(solved.columns)
    x = x[solved.which]
    step, entered = x[:, :n] - solved.at, x[:, n:]
    lines = solved.core_lines(new)
    square = grams.core_a.among(new)
    out = solved.losses + 2.0 * np.einsum("bk,bk->b", solved.core_slope, step)
    slope = (lines @ (x[:, :n])[:, :, None])[:, :, 0] - grams.core_b[:, new]
    out += 2.0 * np.einsum("bm,bm->b", slope, entered) + np.einsum("bm,bmk,bk->b", entered, square, entered)
    # Moves of other limbs hardly answer: most steps are rounding.
    size = np.abs(step).max(axis=0) ** 2 * solved.core_diagonal
    used = np.flatnonzero(size > _NOTHING * max(float(size.max(initial=0.0)), 1.0))
    _form(out, solved.core, used, np.ascontiguousarray(step[:, used]))
    return out


@fused
def _form(out: Array, values: Array, used: Array, x: Array) -> None:
    """Add ``x values[:, used, used] x`` of each block."""
    for block in range(len(out)):
        for i in range(len(used)):
            line = values[block, used[i]]
            inner = 0.5 * line[used[i]] * x[block, i]
            for k in range(i):
                inner += line[used[k]] * x[block, k]
            out[block] += 2.0 * inner * x[block, i]
