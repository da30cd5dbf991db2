"""Proportions with Wilson's interval."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import sqrt

Z95 = 1.959963984540054


@dataclass(frozen=True)
class Proportion:
    """``hits`` of ``total``, with the 95 % score interval; an empty one is told as such."""

    hits: int
    total: int

    @property
    def share(self) -> float:
        return self.hits / self.total if self.total else float("nan")

    @property
    def interval(self) -> tuple[float, float]:
        return wilson(self.hits, self.total)

    def __str__(self) -> str:
        if not self.total:
            return "-"
        low, high = self.interval
        return f"{100 * self.share:.0f} % ({100 * low:.0f} to {100 * high:.0f})"

    def as_json(self) -> dict:
        return {"hits": self.hits, "total": self.total, "interval": list(self.interval) if self.total else None}


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
