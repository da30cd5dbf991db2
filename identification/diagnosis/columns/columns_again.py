"""The columns of a search once more: for the judged band, and at the positions that the encoders read."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identification.diagnosis.columns.residual_columns import Columns, effect_columns, plain_columns
from identification.diagnosis.columns.session import Session

# Edges of the judged band: beside its filter one that ends so high changes what it leaves by at most 2.5 %.
_PASSES_WHOLE = 1.5


def where_read(session: Session, columns: Columns) -> Columns:
    """Columns with tolerance parameters and rigid bodies at the positions as read, in the gravity of the given model.

    Fits without effects that displace the links need these.

    Args:
        session: Robot and logs of the columns.
        columns: At the true positions of links that effects displace.
    """
    values = []
    for k, own in enumerate(columns.values):
        plain = (np.column_stack(row) for row in plain_columns(session, k, columns.operations[k]))
        values.append(tuple(np.hstack([new, old[:, new.shape[1] :]]) for new, old in zip(plain, own, strict=True)))
    return replace(columns, values=tuple(values), displaced=())


def reaching_beyond(session: Session, columns: Columns) -> Columns:
    """Columns that hold the judged band whole: those made of accelerations end half as high again.

    A column that ends at the edge of the judged band, and is filtered there again, lacks what lies near the edge; the
    torque that it explains does not. Columns at the positions of displaced links stay as they are.

    Args:
        session: Robot and logs of the columns.
        columns: Of which those made of accelerations end at the edge of the judged band.
    """
    if columns.displaced:
        return columns
    values = []
    blocks = [block for block in columns.local if block.effect.uses_acceleration]
    for k, own in enumerate(columns.values):
        operation = columns.operations[k].short_lived_copy()
        plain = (np.column_stack(row) for row in plain_columns(session, k, operation, beyond=_PASSES_WHOLE))
        rows = [np.hstack([new, old[:, new.shape[1] :]]) for new, old in zip(plain, own, strict=True)]
        for block in blocks:
            parts = effect_columns(session, k, operation, block, _PASSES_WHOLE * session.cutoff_hz)
            for row, part in zip(block.rows, parts, strict=True):
                first = columns.rows[row].index(block.first)
                rows[row][:, first : first + block.count] = part
        values.append(tuple(rows))
    return replace(columns, values=tuple(values))
