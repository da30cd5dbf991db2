"""Selection of the columns that fits of a few effects need, for a smaller fitting problem."""

from __future__ import annotations

from collections.abc import Set as AbstractSet
from dataclasses import replace

import numpy as np

from identification.diagnosis.columns.residual_columns import Columns
from identification.diagnosis.columns.terms import Term


def columns_for(columns: Columns, terms: AbstractSet[Term]) -> tuple[Columns, dict[Term, Term]]:
    """Columns of the model's parameters and of some effects, and the new term of each of these effects.

    Args:
        columns: Columns of all effects.
        terms: The effects. Other effects all of whose columns are kept stay candidates.
    """
    wanted = {column for term in terms for column in term.columns}
    kept = [k for k in range(len(columns.names)) if k < columns.model_count or k in wanted]
    place = {column: at for at, column in enumerate(kept)}
    moved = {
        term: replace(term, columns=tuple(place[column] for column in term.columns))
        for term in columns.terms
        if place.keys() >= term.column_set
    }
    inside = [np.array([column in place for column in row], dtype=bool) for row in columns.rows]
    few = replace(
        columns,
        names=tuple(columns.names[k] for k in kept),
        terms=tuple(moved.values()),
        rows=tuple(tuple(place[column] for column in row if column in place) for row in columns.rows),
        values=tuple(
            tuple(np.ascontiguousarray(part[:, own]) for part, own in zip(log, inside, strict=True))
            for log in columns.values
        ),
        local=tuple(replace(b, first=place[b.first]) for b in columns.local if b.first in place),
    )
    return few, {term: moved[term] for term in terms}
