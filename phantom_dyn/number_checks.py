"""Checks numbers that a caller gives; each error message names the argument."""

from __future__ import annotations

import math

import numpy as np

from phantom_dyn.array_types import Array
from phantom_dyn.errors import ParameterError

# Largest number of samples of one experiment: almost a gigabyte for each column.
_MOST_SAMPLES = 10**8


def require_numbers(**values: float) -> None:
    """Refuse numbers that are not finite. The message names the argument, with blanks for underscores.

    Raises:
        ParameterError: If a value is NaN or infinite.
    """
    for name, value in values.items():
        if not math.isfinite(value):
            raise ParameterError(f"The {name.replace('_', ' ')} is {value}: give a finite number.")


def require_positive(owner: str = "", /, **values: float) -> None:
    """Refuse numbers that are not finite and above 0.

    Args:
        owner: Object to which the numbers belong, such as ``the loop``, for the message.
        values: Numbers by the names of their arguments.

    Raises:
        ParameterError: If a value is 0 or less, or not finite.
    """
    for name, value in values.items():
        if not (math.isfinite(value) and value > 0):
            raise ParameterError(f"The {_named(name, owner)} is {value}: give a number above 0.")


def require_not_negative(owner: str = "", /, **values: float) -> None:
    """Refuse numbers that are not finite or below 0; arguments as in `require_positive`.

    Raises:
        ParameterError: If a value is negative or not finite.
    """
    for name, value in values.items():
        if not (math.isfinite(value) and value >= 0):
            raise ParameterError(f"The {_named(name, owner)} is {value}: give a number of 0 or more.")


def _named(name: str, owner: str) -> str:
    return name.replace("_", " ") + (f" of {owner}" if owner else "")


def require_whole(least: int, **values: float) -> None:
    """Refuse numbers that are not integers of at least ``least``.

    Raises:
        ParameterError: If a value has a fraction, is too small or not finite.
    """
    for name, value in values.items():
        if not (math.isfinite(value) and value == int(value) and value >= least):
            raise ParameterError(f"The {name.replace('_', ' ')} is {value}: give a whole number of {least} or more.")


def require_columns(count: int, **values: Array) -> None:
    """Refuse arrays that do not have ``count`` finite numbers.

    Raises:
        ParameterError: If an array has another shape, or contains NaN or infinity.
    """
    for name, value in values.items():
        shape = np.shape(value)
        if shape != (count,):
            raise ParameterError(
                f"The {name.replace('_', ' ')} has the shape {shape}: give one number for each of {count} samples."
            )
        bad = np.flatnonzero(~np.isfinite(value))
        if len(bad):
            raise ParameterError(
                f"The {name.replace('_', ' ')} is {np.asarray(value)[bad[0]]} at sample {bad[0]}: give finite numbers."
            )


def sample_count(duration: float, period: float) -> int:
    """Number of samples in an experiment of a duration [s] with a sampling period [s], at least one.

    Raises:
        ParameterError: If either is not above 0, or the number of samples is below one or above a hundred million.
    """
    require_positive(period=period, duration=duration)
    count = round(min(duration / period, 2.0 * _MOST_SAMPLES))
    if not 1 <= count <= _MOST_SAMPLES:
        raise ParameterError(
            f"A duration of {duration:g} s at a sampling period of {period:g} s was given: give a duration of at least "
            f"one period and at most {_MOST_SAMPLES} periods."
        )
    return count
