"""Finds rows that a recorder repeated until the robot was read again, as in a log at 200 Hz of a bus with 50 Hz.

Several rows then have exactly the same values in all columns. Used as samples, they would mean that the robot stops and
jumps. A robot at rest, or a coarse encoder, repeats rows too, but each a different number of times. So rows are dropped
only if they are repeated at a constant rate.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from phantom_dyn.array_types import Array, Bool, Float

# Repeated rows are dropped only if they are at least the first share of all rows, and if at least the second share of
# the readings is repeated at one constant rate.
_LEAST_REPEATED, _AT_ONE_RATE = 0.3, 0.9
# Smallest number of readings with which a rate is determined.
_FEWEST = 50
# A reading that is repeated more often than this multiple of the median is a standstill, and is not used for the rate.
_STANDSTILL = 3.0


def rows_once_read(columns: Mapping[str, Float[Array, " N"]]) -> tuple[Bool[Array, " N"], float]:
    """True for rows with a new reading, and the number of rows per reading; all rows and 1 if no rows are repeated.

    In a standstill, readings do not change. Rows are then kept at the rate of the readings.

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
    rows_per_reading = float(moving.mean())
    # At a constant rate, each reading has the mean number of rows, rounded down or up.
    at_one_rate = np.mean((moving == np.floor(rows_per_reading)) | (moving == np.ceil(rows_per_reading)))
    if 1.0 - 1.0 / rows_per_reading < _LEAST_REPEATED or at_one_rate < _AT_ONE_RATE:
        return every, 1.0
    kept = np.zeros(len(values), dtype=bool)
    for first, count in zip(new, np.append(rows, len(values) - new[-1]), strict=True):
        readings = max(round(count / rows_per_reading), 1)
        kept[first + np.floor(np.arange(readings) * rows_per_reading).astype(int)] = True
    return kept, rows_per_reading
