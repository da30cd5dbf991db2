"""Claims of a diagnosis: tested causes with the results of the gates that each of them passed or failed.

A claim says that a cause is present in the recordings. A gate is a test that a claim has to pass. The gain of a cause
is the decrease of the squared residual, in units of the noise variance, when the cause is added to a fit.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Generic, Literal, TypeVar

Outcome = Literal["claimed", "minor", "not_claimed", "displaced"]
Data = Literal["torques", "poses", "rests"]

NEVER_CLAIMED = 10
"""A ledger lists all claims, and at most this many causes that were never claimed: those with the largest gain."""
# An unclaimed cause counts as displaced by a claimed one only if alone it reaches this share of that one's gain.
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
    def closeness(self) -> float:
        """How nearly the gate is passed: value over needed value, or their difference if zero is needed."""
        return self.value / self.needed if self.needed > 0.0 else self.value - self.needed


@dataclass(frozen=True)
class Claim(Generic[Name]):
    """One tested cause, or several that act together, with the results of the gates.

    Attributes:
        effects: The cause: one effect, or several that act together.
        gates: Results in the order in which the gates are applied, up to the first that the claim failed.
        outcome: ``claimed``; ``minor`` if the cause is real but too small to matter; ``displaced`` if other causes
            explain the same part of the gap; else ``not_claimed``.
        instead: The causes that displaced this one.
        figures: Further numbers, by name.
        judged_by: Kind of data on which the claim was tested; ``rests`` are recordings of a robot at rest.
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


def could_replace(lone_gain: float, needed: float, added_gain: float, claimed_gain: float) -> bool:
    """True if an unclaimed cause counts as displaced by a claimed one: it gains much alone, but little after the other.

    Args:
        lone_gain: Gain of the unclaimed cause without the claimed one.
        needed: Gain from which a cause can be claimed.
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


def easiest_test(gate: str, ways: Iterable[tuple[float, float, str]]) -> GateResult:
    """Result of a gate with several alternative tests: of the first test that passes, or of the most nearly passed one.

    Args:
        gate: Name of the gate.
        ways: Value, needed value and unit of each test; tests after the first that passes are not computed.
    """
    tried: list[GateResult] = []
    for value, needed, unit in ways:
        tried.append(GateResult(gate, value, needed, unit, value > needed))
        if tried[-1].passed:
            return tried[-1]
    return max(tried, key=lambda result: result.closeness)


def worst_failure(results: Mapping[Key, GateResult]) -> Key | None:
    """The claim with the lowest `GateResult.closeness` among those that fail a gate; None if all claims pass."""
    failed = {key: result.closeness for key, result in results.items() if not result.passed}
    return min(failed, key=lambda key: failed[key], default=None)


def until_nothing_changes(state: State, steps: Sequence[Callable[[State], State]]) -> State:
    """The state after applying steps until no step changes it. After each change the first step is applied again.

    A step that changes nothing has to return the same object that it was given.
    """
    while True:
        for step in steps:
            after = step(state)
            if after is not state:
                state = after
                break
        else:
            return state
