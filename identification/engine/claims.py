"""What is claimed of a residual, and what each gate said that the claim met: the entries of a ledger."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Generic, Literal, TypeVar

Outcome = Literal["claimed", "minor", "not_claimed", "displaced"]
Data = Literal["torques", "poses", "rests"]

NEVER_CLAIMED = 10
"""Entries of a ledger that were never claimed, the best."""
# Share of the gain of a cause from which on another cause counts as displaced by it.
_STANDS_FOR = 0.2

Name = TypeVar("Name")
Key = TypeVar("Key", bound=Hashable)
State = TypeVar("State")


@dataclass(frozen=True)
class GateResult:
    """What one gate said of a claim.

    Attributes:
        gate: Its name, as in `identification.gates.GATES`.
        value: The figure of the claim.
        needed: What the figure has to exceed.
        unit: Of both.
        passed: Whether it does.
    """

    gate: str
    value: float
    needed: float
    unit: str
    passed: bool

    @property
    def part(self) -> float:
        """Value over what was needed, by which failures of one gate are compared; the difference if that is nothing."""
        return self.value / self.needed if self.needed > 0.0 else self.value - self.needed


@dataclass(frozen=True)
class Claim(Generic[Name]):
    """One cause that was looked at, or several that act together, with what decided on it.

    Attributes:
        effects: What is claimed.
        gates: Results in the order in which the gates are asked, up to the first that the claim failed.
        outcome: ``claimed``; ``minor`` if it is seen but too small to matter; ``displaced`` if others explain it
            instead; else ``not_claimed``.
        instead: What took its place.
        figures: What else was measured of it, by name.
        judged_by: The data that it was judged by.
    """

    effects: tuple[Name, ...]
    gates: tuple[GateResult, ...]
    outcome: Outcome
    instead: tuple[Name, ...] = ()
    figures: Mapping[str, float] = field(default_factory=dict)
    judged_by: Data = "torques"

    @property
    def failed(self) -> GateResult | None:
        """The gate that the claim did not pass; None if it passed all that it met."""
        return next((result for result in self.gates if not result.passed), None)


def could_stand_for(instead_of: float, needed: float, beside: float, of_other: float) -> bool:
    """True if a cause that is not claimed could stand for one that is.

    Args:
        instead_of: What it gains without that one.
        needed: What a claim of it needs.
        beside: What it gains beside that one.
        of_other: What that one gains.
    """
    return instead_of > max(needed, 2.0 * beside, _STANDS_FOR * of_other)


def until_failed(results: Iterable[GateResult]) -> tuple[GateResult, ...]:
    """Results up to the first that failed; later ones are not computed."""
    out: list[GateResult] = []
    for result in results:
        out.append(result)
        if not result.passed:
            break
    return tuple(out)


def easiest(gate: str, ways: Iterable[tuple[float, float, str]]) -> GateResult:
    """The result of a gate that may be passed in several ways: the first that passes, or the one that comes nearest.

    Args:
        gate: Its name.
        ways: Value, what is needed and unit of each; later ones are not computed once one passes.
    """
    tried: list[GateResult] = []
    for value, needed, unit in ways:
        tried.append(GateResult(gate, value, needed, unit, value > needed))
        if tried[-1].passed:
            return tried[-1]
    return max(tried, key=lambda result: result.part)


def fails_worst(results: Mapping[Key, GateResult]) -> Key | None:
    """The claim that falls shortest of one gate, by value over what was needed; None if all pass."""
    failed = {key: result.part for key, result in results.items() if not result.passed}
    return min(failed, key=lambda key: failed[key], default=None)


def until_nothing_changes(state: State, steps: Sequence[Callable[[State], State]]) -> State:
    """A state that none of some steps changes: after each change the first step is taken again.

    A step returns the very state that it was given where it changes nothing.
    """
    while True:
        for step in steps:
            after = step(state)
            if after is not state:
                state = after
                break
        else:
            return state
