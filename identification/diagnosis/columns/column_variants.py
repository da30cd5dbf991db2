"""Variants of the columns of a search: computed at the positions that the encoders read, or with a wider band.

In a search, columns made of accelerations are low-passed to the judged band, the lower part of the band of the fits.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identification.diagnosis.columns.residual_columns import Columns, effect_columns, model_columns
from identification.diagnosis.columns.session import Session

# Cutoff of the wider band, in cutoffs of the judged band. After the filter of the judged band, columns with this cutoff
# differ by at most 2.5 % from unfiltered columns.
_PASSES_WHOLE = 1.5


def columns_at_readings(session: Session, columns: Columns) -> Columns:
    """Columns whose tolerance parameters and rigid bodies are computed at the positions that the encoders read.

    Fits without effects that displace the links or tilt the base need these columns.

    Args:
        session: Robot and logs of the columns.
        columns: The columns at the true positions of links that effects displace.
    """
    values = []
    for k, old_rows in enumerate(columns.values):
        new_rows = (np.column_stack(row) for row in model_columns(session, k, columns.operations[k]))
        values.append(
            tuple(np.hstack([new, old[:, new.shape[1] :]]) for new, old in zip(new_rows, old_rows, strict=True))
        )
    return replace(columns, values=tuple(values), displaced=())


def with_wider_band(session: Session, columns: Columns) -> Columns:
    """Columns in which those made of accelerations have 1.5 times the cutoff of the judged band.

    Columns and torque are later filtered into the judged band. Columns that have this cutoff already would be filtered
    twice, and be too small near the cutoff compared with the torque. If effects displace the links, the columns are
    returned unchanged.

    Args:
        session: Robot and logs of the columns.
        columns: Columns; those made of accelerations have the cutoff of the judged band.
    """
    if columns.displaced:
        return columns
    values = []
    blocks = [block for block in columns.term_columns if block.effect.uses_acceleration]
    for k, old_rows in enumerate(columns.values):
        operation = columns.operations[k].short_lived_copy()
        new_rows = (np.column_stack(row) for row in model_columns(session, k, operation, beyond=_PASSES_WHOLE))
        rows = [np.hstack([new, old[:, new.shape[1] :]]) for new, old in zip(new_rows, old_rows, strict=True)]
        for block in blocks:
            parts = effect_columns(session, k, operation, block, _PASSES_WHOLE * session.cutoff_hz)
            for row, part in zip(block.rows, parts, strict=True):
                first = columns.rows[row].index(block.first)
                rows[row][:, first : first + block.count] = part
        values.append(tuple(rows))
    return replace(columns, values=tuple(values))
