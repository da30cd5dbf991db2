"""The figures of the sealed cases, what is to be reached, and whether it is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import isfinite

from .judged import Judged
from .proportions import Average, Proportion, average, proportion

Cases = Sequence[Judged]
Score = Proportion | Average


@dataclass(frozen=True)
class Figure:
    """One row of the table.

    Attributes:
        name: As printed.
        low, high: What is to be reached, both ends included; a row without an aim leaves both open.
        aim: The same in words.
        of: The figure of some cases.
        more: Whether more is better, less, or (None) what lies between both ends.
    """

    name: str
    low: float
    high: float
    aim: str
    of: Callable[[Cases], Score]
    more: bool | None

    def met(self, score: Score) -> bool | None:
        """Whether the aim is reached; None without an aim or without cases."""
        if not self.aim or not isfinite(score.value):
            return None
        return self.low <= score.value <= self.high

    def badness(self, value: float) -> float:
        """How bad a value is, larger is worse; only the order counts."""
        if self.more is None:
            return max(self.low - value, value - self.high)
        return -value if self.more else value


def of_kind(cases: Cases, *kinds: str) -> list[Judged]:
    """Those of the given kinds."""
    return [x for x in cases if x.kind in kinds]


def _singles(cases: Cases) -> list[Judged]:
    return of_kind(cases, "single")


def _inside(cases: Cases) -> list[Judged]:
    return of_kind(cases, "single", "pair")


def _at_most(name: str, share: float, of: Callable[[Cases], Score]) -> Figure:
    return Figure(name, 0.0, share, f"at most {100 * share:.0f} %", of, more=False)


def _at_least(name: str, share: float, of: Callable[[Cases], Score]) -> Figure:
    return Figure(name, share, 1.0, f"at least {100 * share:.0f} %", of, more=True)


FIGURES = (
    _at_most("false claims on nulls", 0.02, lambda c: proportion(x.false_claim for x in of_kind(c, "null"))),
    _at_most("extra finding that is not there", 0.05, lambda c: proportion(x.extra for x in _inside(c))),
    _at_most("`unknown` inside the catalogue", 0.05, lambda c: proportion(x.verdict == "unknown" for x in _inside(c))),
    _at_least("joint named right", 0.98, lambda c: proportion(x.joint for x in _inside(c))),
    _at_least(
        "leading effect right, exact twins counted as one class",
        0.90,
        lambda c: proportion(x.top1 for x in _singles(c)),
    ),
    Figure(
        "leading effect right, strict",
        0.0,
        1.0,
        "",
        lambda c: proportion(x.top1_strict for x in _singles(c)),
        more=True,
    ),
    _at_least("true effect among the listed ones", 0.97, lambda c: proportion(x.in_set for x in _inside(c))),
    Figure(
        "mean set size, singles",
        0.0,
        1.6,
        "at most 1.6",
        lambda c: average(x.set_size for x in _singles(c) if x.claims),
        more=False,
    ),
    Figure(
        "mean set size, pairs",
        0.0,
        3.2,
        "at most 3.2",
        lambda c: average(x.set_size for x in of_kind(c, "pair") if x.claims),
        more=False,
    ),
    _at_least("both effects of a pair", 0.80, lambda c: proportion(x.all_named for x in of_kind(c, "pair"))),
    _at_least(
        "`unknown` outside the catalogue",
        0.85,
        lambda c: proportion(x.outside_right for x in of_kind(c, "outside")),
    ),
    _at_most(
        "fits but wrong", 0.02, lambda c: proportion(x.wrong_but_fits for x in of_kind(c, "single", "pair", "outside"))
    ),
    Figure(
        "parameter within its 95 % interval",
        0.90,
        0.98,
        "90 to 98 %",
        lambda c: proportion(e for x in _inside(c) for e in x.covered),
        more=None,
    ),
    _at_least(
        "gap closed, share of an oracle that knows the cause",
        0.95,
        lambda c: average((x.of_oracle for x in _inside(c)), share=True),
    ),
    Figure(
        "no claim on a case with an effect",
        0.0,
        1.0,
        "",
        lambda c: proportion(not x.claims for x in _inside(c)),
        more=False,
    ),
    Figure("nothing but the truth named", 0.0, 1.0, "", lambda c: proportion(x.exact for x in _inside(c)), more=True),
    Figure(
        "a cause named on a null",
        0.0,
        1.0,
        "",
        lambda c: proportion(bool(x.claims) for x in of_kind(c, "null")),
        more=False,
    ),
)
# Of a method that states neither residuals, rivals nor intervals.
BASELINE_FIGURES = tuple(f for f in FIGURES if not f.name.startswith(("parameter", "gap closed")))


def missed(cases: Cases, floors: float) -> list[Judged]:
    """Singles of at least so many noise floors in which neither the truth nor a twin of it is a finding."""
    return [x for x in beyond(of_kind(cases, "single"), floors) if not x.all_named]


def beyond(cases: Cases, floors: float) -> list[Judged]:
    """Nulls, and the other cases of at least so many noise floors (of a pair: the smaller effect)."""
    return [x for x in cases if x.kind == "null" or x.gap >= floors]
