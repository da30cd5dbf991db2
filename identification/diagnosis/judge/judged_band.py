"""The judged band: least squares fits of the chosen effects there, and which of them are visible above its noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from identification.diagnosis.columns.residual_columns import Columns, where_read
from identification.diagnosis.columns.session import Series
from identification.diagnosis.columns.terms import Term, ordered
from identification.diagnosis.fit.gap import Sums, judged_noise, sums
from identification.diagnosis.fit.problem import Problem, set_up
from identification.diagnosis.noise.noise_floor import weights_of
from identification.diagnosis.search.search import Search, set_up_search
from phantom_dyn.array_types import Array, Float


@dataclass(frozen=True)
class Judge:
    """Problem and noise floor of the band in which gaps are measured.

    Attributes:
        problem: Columns and fits.
        floor: Noise floor of each joint in that band, ``(nv,)``.
        highest: Upper end of its interval, ``(nv,)``.
    """

    problem: Problem
    floor: Float[Array, " nv"]
    highest: Float[Array, " nv"]

    def narrow(self, series: Series) -> Series:
        """Series of each log in the judged band."""
        return self.problem.session.in_judged_band(series)


def growth_without(left: Callable[[frozenset[Term]], Sums], chosen: frozenset[Term]) -> dict[Term, float]:
    """Growth of the squared residual without each of some effects, on the joint that needs it most.

    An effect can be significant only above the judged band, where it is of no use and the model of the noise is least
    known: there it grows by nothing. One that costs the other joints more than it helps counts as minus one.

    Args:
        left: What a set of them leaves in the judged band.
        chosen: The effects.
    """
    base, growth = np.maximum(left(chosen).rms() ** 2, 1e-300), {}
    for term in ordered(chosen):
        ratio = left(chosen - {term}).rms() ** 2 / base
        growth[term] = float(np.max(ratio)) - 1.0 if np.mean(ratio) > 1.0 else -1.0
    return growth


def growth_of_gap(problem: Problem, noise: Series) -> float:
    """How far the squared residual of the given model is above that of noise on the joint with most, relative."""
    floor = judged_noise(problem, noise)
    given = sums(problem, problem.session.in_judged_band(problem.columns.residual)).rms()
    return float(np.max(given**2 / floor**2)) - 1.0


def narrow_search(search: Search, noise: Series) -> Search:
    """The same search with fits by plain least squares in the judged band.

    Whitened fits tell effects apart best. Once the effects are chosen, the plain fit is the one that closes the gap,
    and its parameters suffer less where a real effect is not quite its law.
    """
    columns = search.problem.columns
    return search_below(search, columns, noise, np.full(len(columns.rows), search.problem.session.cutoff_hz))


def search_below(search: Search, columns: Columns, noise: Series, edges: Float[Array, " nv"]) -> Search:
    """The same search with plain fits by what lies below a frequency of each joint.

    Args:
        search: Rivals.
        columns: Its columns, or the fewer of those rivals that are asked for: their products take most memory.
        noise: Of each log's torque.
        edges: Frequencies [Hz].
    """
    session = search.problem.session

    def each(series: Series) -> Series:
        return tuple(
            part
            if (edges >= 0.99 * session.logs[k].band.cutoff_hz).all()
            else np.column_stack([session.log_below(x, k, edges[j]) for j, x in enumerate(part.T)])
            for k, part in enumerate(series)
        )

    def below(columns: Columns) -> Columns:
        return replace(
            columns,
            values=tuple(
                tuple(session.log_below(x, k, edges[j]) for j, x in enumerate(rows))
                for k, rows in enumerate(columns.values)
            ),
            residual=each(columns.residual),
            model_torque=each(columns.model_torque),
        )

    narrow = below(columns)
    weights = weights_of(narrow, each(noise))
    plain = set_up(session, columns, narrow, weights)
    if columns.displaced:
        read = where_read(session, columns)
        plain = replace(plain, where_read=set_up(session, read, below(read), weights))
    return set_up_search(plain, search.threshold, search.rows, search.spurious, search.record)
