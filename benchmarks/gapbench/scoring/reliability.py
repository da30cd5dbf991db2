"""Are stated probabilities right as often as they say?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from statistics import fmean

from .judged import Judged
from .proportions import proportion

EDGES = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 0.99, 1.0)


@dataclass(frozen=True)
class Bin:
    """Answers whose stated probability lies between two edges.

    Attributes:
        low, high: Edges; the upper one belongs to the last bin only.
        stated: Mean stated probability, nan without any.
        right: For each answer, whether it was right.
    """

    low: float
    high: float
    stated: float
    right: tuple[bool, ...]

    @property
    def name(self) -> str:
        return f"{self.low:g} to {self.high:g}"


def reliability(cases: Sequence[Judged]) -> list[Bin]:
    """All stated probabilities, of nulls and causes outside the catalogue too, in bins.

    A finding and its rivals are one answer each, those that are twins of the truth together one.
    """
    stated = [pair for case in cases for pair in case.stated]
    out = []
    for low, high in pairwise(EDGES):
        mine = [(p, right) for p, right in stated if low <= p < high or (high == EDGES[-1] and p >= high)]
        mean = fmean(p for p, _ in mine) if mine else float("nan")
        out.append(Bin(low, high, mean, tuple(right for _, right in mine)))
    return out


def bins_as_json(cases: Sequence[Judged]) -> list[dict]:
    """Bins that hold an answer, for programs."""
    return [
        {"low": b.low, "high": b.high, "stated": b.stated, **proportion(b.right).as_json()}
        for b in reliability(cases)
        if b.right
    ]


def calibration_error(cases: Sequence[Judged]) -> float:
    """Mean over all answers of the distance of a bin's mean statement from its share of right ones."""
    bins = [b for b in reliability(cases) if b.right]
    total = sum(len(b.right) for b in bins)
    return sum(len(b.right) * abs(b.stated - fmean(b.right)) for b in bins) / total if total else float("nan")
