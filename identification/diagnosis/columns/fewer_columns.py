"""Selects the columns that fits of a few effects need, for a smaller fitting problem."""

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
    new_index = {column: at for at, column in enumerate(kept)}
    renumbered = {
        term: replace(term, columns=tuple(new_index[column] for column in term.columns))
        for term in columns.terms
        if new_index.keys() >= term.column_set
    }
    is_kept = [np.array([column in new_index for column in row], dtype=bool) for row in columns.rows]
    few = replace(
        columns,
        names=tuple(columns.names[k] for k in kept),
        terms=tuple(renumbered.values()),
        rows=tuple(tuple(new_index[column] for column in row if column in new_index) for row in columns.rows),
        values=tuple(
            tuple(np.ascontiguousarray(part[:, own]) for part, own in zip(log, is_kept, strict=True))
            for log in columns.values
        ),
        term_columns=tuple(replace(b, first=new_index[b.first]) for b in columns.term_columns if b.first in new_index),
    )
    return few, {term: renumbered[term] for term in terms}
