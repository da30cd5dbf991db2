"""Rows that a recorder wrote again before the robot was read again: a bus of 50 Hz logged at 200 Hz.

Each reading then stands in several rows, exactly, in all columns. Taken as samples, these rows make the robot stand and
jump, and the noise seems slow. A joint that stands, or an encoder that counts slowly, repeats rows as well, but for
times that differ: only repeats at one rate are dropped.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from phantom_dyn.array_types import Array, Bool, Float

# Least share of repeated rows that is worth dropping; and of readings that follow one another at one rate.
_LEAST_REPEATED, _AT_ONE_RATE = 0.3, 0.9
# Fewest readings from which a rate is known.
_FEWEST = 50
# Readings that stay for more than so many of the usual times are a standstill, and say nothing about the rate.
_STANDSTILL = 3.0


def rows_once_read(columns: Mapping[str, Float[Array, " N"]]) -> tuple[Bool[Array, " N"], float]:
    """Rows with a new reading, and the number of rows a reading; all rows and one where each row is a reading.

    Of a standstill, in which readings do not change, one row per reading is kept.

    Args:
        columns: Columns of a log by name, with the time ``t``.
    """
    values = np.column_stack([column for name, column in columns.items() if name != "t"])
    every = np.ones(len(values), dtype=bool)
    new = np.flatnonzero(np.append(True, (values[1:] != values[:-1]).any(axis=1)))
    rows = np.diff(new)
    if len(rows) < _FEWEST:
        return every, 1.0
    moving = rows[rows <= _STANDSTILL * np.median(rows)]
    each = float(moving.mean())
    at_one_rate = np.mean((moving == np.floor(each)) | (moving == np.ceil(each)))
    if 1.0 - 1.0 / each < _LEAST_REPEATED or at_one_rate < _AT_ONE_RATE:
        return every, 1.0
    kept = np.zeros(len(values), dtype=bool)
    for first, count in zip(new, np.append(rows, len(values) - new[-1]), strict=True):
        readings = max(round(count / each), 1)
        kept[first + np.floor(np.arange(readings) * each).astype(int)] = True
    return kept, each
