"""Formats numbers as text: values with standard deviation and unit, percentages, and probabilities of findings."""

from __future__ import annotations

import math
from collections.abc import Callable

from identification.diagnosis.result import Value
from identification.notes import Note

NO_BREAK = "\N{NO-BREAK SPACE}"  # keeps a number and its unit on one line


def value_words(value: Value) -> str:
    """An estimate as ``0.0510 ± 0.0006 N m``; several values are separated by commas."""
    return with_unit(", ".join(map(with_std, value.numbers, value.stds)), value.unit)


def with_unit(text: str, unit: str) -> str:
    """A number with its unit; the unit of a ratio, ``1``, is left out."""
    return text if unit in ("", "1") else f"{text} {unit}"


def with_std(value: float, std: float) -> str:
    """A number with its standard deviation, both rounded to the second digit of the deviation."""
    if not (math.isfinite(std) and std > 0 and math.isfinite(value)):
        return number(value)
    exponent = math.floor(math.log10(max(abs(value), std)))
    digits = max(0, 1 - math.floor(math.log10(std)))
    if -4 <= exponent <= 5 and digits <= 8:
        return f"{_no_minus_zero(f'{value:.{digits}f}')} ± {std:.{digits}f}"
    scale = 10.0**exponent
    digits = min(12, max(0, 1 - math.floor(math.log10(std / scale))))
    return f"({value / scale:.{digits}f} ± {std / scale:.{digits}f})e{exponent}"


def _no_minus_zero(text: str) -> str:
    """A rounded number without the sign of ``-0``."""
    return text if float(text) else text.removeprefix("-")


def number(value: float, digits: int = 3) -> str:
    """A number with ``digits`` significant digits, below a million without an exponent; a dash if it is not finite."""
    if not math.isfinite(value):
        return "–"
    text = _no_minus_zero(f"{value:.{digits}g}")
    return f"{float(text):.0f}" if "e+" in text and abs(value) < 1e6 else text


def percent(share: float) -> str:
    """A share as a percentage; ``0 %`` and ``100 %`` only for exactly these shares; a dash if it is not finite."""
    if not math.isfinite(share):
        return "–"
    if 0 < abs(share) < 0.005:
        return f"under 1{NO_BREAK}%"
    if 0.995 <= share < 1:
        return f"over 99{NO_BREAK}%"
    return f"{100 * share:.0f}{NO_BREAK}%"


def percent_short_of_all(share: float) -> str:
    """A share as a percentage of at most ``over 99 %``, because no recording can prove 100 % of a gap."""
    return percent(min(share, 0.999))


def filled(template: str) -> Callable[[Note], str]:
    """A function that builds the sentence of a note by filling a template with the note's joint and numbers."""
    return lambda note: template.format(joint=note.joint, **note.numbers)
