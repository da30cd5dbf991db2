"""Proportions with Wilson's interval, means with theirs."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import isfinite, sqrt
from statistics import fmean, median, stdev

Z95 = 1.959963984540054


@dataclass(frozen=True)
class Proportion:
    """``hits`` of ``total``, with the 95 % score interval; an empty one is said to be."""

    hits: int
    total: int

    @property
    def value(self) -> float:
        return self.hits / self.total if self.total else float("nan")

    @property
    def interval(self) -> tuple[float, float]:
        return wilson(self.hits, self.total)

    def __str__(self) -> str:
        if not self.total:
            return "-"
        low, high = self.interval
        return f"{100 * self.value:.0f} % ({100 * low:.0f} to {100 * high:.0f})"

    def as_json(self) -> dict:
        return {"hits": self.hits, "total": self.total, "interval": list(self.interval) if self.total else None}


@dataclass(frozen=True)
class Average:
    """Mean of ``total`` values with its 95 % normal interval; shares are written as per cent."""

    value: float
    total: int
    interval: tuple[float, float]
    share: bool = False

    def __str__(self) -> str:
        if not self.total:
            return "-"
        low, high = self.interval
        if self.share:
            return f"{100 * self.value:.1f} % ({100 * low:.1f} to {100 * high:.1f})"
        return f"{self.value:.2f} ({low:.2f} to {high:.2f})"

    def as_json(self) -> dict:
        return {"mean": self.value if self.total else None, "total": self.total, "interval": list(self.interval)}


def wilson(hits: int, total: int, z: float = Z95) -> tuple[float, float]:
    """Score interval of a proportion (E. B. Wilson, JASA 22, 1927)."""
    if not 0 <= hits <= total:
        raise ValueError(f"{hits} hits of {total} are no proportion: give 0 <= hits <= total.")
    if total == 0:
        return 0.0, 1.0
    p, z2 = hits / total, z * z / total
    middle, half = p + z2 / 2.0, z * sqrt(p * (1.0 - p) / total + z2 / (4.0 * total))
    return max(0.0, (middle - half) / (1.0 + z2)), min(1.0, (middle + half) / (1.0 + z2))


def proportion(outcomes: Iterable[bool]) -> Proportion:
    """Share of true outcomes."""
    outcomes = list(outcomes)
    return Proportion(sum(map(bool, outcomes)), len(outcomes))


def average(values: Iterable[float], *, share: bool = False) -> Average:
    """Mean of the finite values."""
    finite = [x for x in values if isfinite(x)]
    if not finite:
        return Average(float("nan"), 0, (0.0, 0.0), share)
    mean = fmean(finite)
    half = Z95 * stdev(finite) / sqrt(len(finite)) if len(finite) > 1 else 0.0
    high = min(1.0, mean + half) if share else mean + half
    return Average(mean, len(finite), (mean - half, high), share)


def middle(values: Iterable[float]) -> float | None:
    """Median of the finite values; None without any."""
    finite = [x for x in values if isfinite(x)]
    return float(median(finite)) if finite else None
