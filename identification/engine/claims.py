"""Claims of a diagnosis: tested causes with the results of the gates that each of them passed or failed."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Generic, Literal, TypeVar

Outcome = Literal["claimed", "minor", "not_claimed", "displaced"]
Data = Literal["torques", "poses", "rests"]

NEVER_CLAIMED = 10
"""Largest number of never claimed causes in a ledger (the list of all claims). It holds those with the largest gain."""
# A cause counts as displaced by a claimed one only if, in its place, it reaches this share of the claimed cause's gain.
_LEAST_SHARE_OF_GAIN = 0.2

Name = TypeVar("Name")
Key = TypeVar("Key", bound=Hashable)
State = TypeVar("State")


@dataclass(frozen=True)
class GateResult:
    """Result of one gate for one claim.

    Attributes:
        gate: Name of the gate, as in `identification.gates.GATES`.
        value: Number that the gate tests, such as a gain.
        needed: Number that `value` is compared with.
        unit: Unit of both numbers.
        passed: True if the claim passes.
    """

    gate: str
    value: float
    needed: float
    unit: str
    passed: bool

    @property
    def part(self) -> float:
        """Value divided by the needed value, to compare failures of one gate; their difference if zero is needed."""
        return self.value / self.needed if self.needed > 0.0 else self.value - self.needed


@dataclass(frozen=True)
class Claim(Generic[Name]):
    """One tested cause, or several that act together, with the results that decided on it.

    Attributes:
        effects: The cause.
        gates: Results in the order in which the gates are applied, up to the first that the claim failed.
        outcome: ``claimed``; ``minor`` if it is seen but too small to matter; ``displaced`` if others explain it
            instead; else ``not_claimed``.
        instead: Causes that replaced it.
        figures: Further numbers, by name.
        judged_by: Kind of recordings to which the gates were applied; ``rests`` are recordings of a robot at rest.
    """

    effects: tuple[Name, ...]
    gates: tuple[GateResult, ...]
    outcome: Outcome
    instead: tuple[Name, ...] = ()
    figures: Mapping[str, float] = field(default_factory=dict)
    judged_by: Data = "torques"

    @property
    def failed(self) -> GateResult | None:
        """The gate that the claim failed; None if it passed all."""
        return next((result for result in self.gates if not result.passed), None)


def could_stand_for(lone_gain: float, needed: float, added_gain: float, claimed_gain: float) -> bool:
    """True if an unclaimed cause explains enough of what a claimed one explains to count as displaced by it.

    Args:
        lone_gain: Gain of the unclaimed cause without the claimed one.
        needed: Gain that a claim needs.
        added_gain: Gain of the unclaimed cause in addition to the claimed one.
        claimed_gain: Gain of the claimed cause.
    """
    return lone_gain > max(needed, 2.0 * added_gain, _LEAST_SHARE_OF_GAIN * claimed_gain)


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
        gate: Name of the gate.
        ways: Value, needed value and unit of each way; ways after the first that passes are not computed.
    """
    tried: list[GateResult] = []
    for value, needed, unit in ways:
        tried.append(GateResult(gate, value, needed, unit, value > needed))
        if tried[-1].passed:
            return tried[-1]
    return max(tried, key=lambda result: result.part)


def fails_worst(results: Mapping[Key, GateResult]) -> Key | None:
    """The claim that fails one gate by most, relative to what the gate needs; None if all claims pass."""
    failed = {key: result.part for key, result in results.items() if not result.passed}
    return min(failed, key=lambda key: failed[key], default=None)


def until_nothing_changes(state: State, steps: Sequence[Callable[[State], State]]) -> State:
    """The state after steps that are repeated, from the first one on after each change, until none changes it.

    A step that changes nothing returns the very object that it was given.
    """
    while True:
        for step in steps:
            after = step(state)
            if after is not state:
                state = after
                break
        else:
            return state
