"""Record of the gates that each effect passed or failed in search and judge, from which the ledger is made."""

from __future__ import annotations

from collections.abc import Iterable

from identification.diagnosis.columns.terms import Term
from identification.engine.claims import GateResult

EffectJoint = tuple[str, str | None]
"""Name of an effect and its joint; None for the whole robot."""


class Record:
    """Decisions on effects, by effect and joint for all shapes together; of each gate the last result counts.

    Structures without a name have no entries of their own; they may be what replaced an effect.
    """

    def __init__(self) -> None:
        self._met: dict[EffectJoint, dict[str, GateResult]] = {}
        self._instead: dict[EffectJoint, tuple[EffectJoint, ...]] = {}

    def kept(self, terms: Iterable[Term], *results: GateResult) -> None:
        """Record that effects have passed gates; earlier failures are cancelled."""
        for term in terms:
            if term.named:
                before = self._met.get(term.effect_joint, {})
                passed = {name: result for name, result in before.items() if result.passed}
                self._met[term.effect_joint] = passed | {result.gate: result for result in results}
                self._instead.pop(term.effect_joint, None)

    def lost(self, terms: Iterable[Term], *results: GateResult, instead: Iterable[Term] = ()) -> None:
        """Record that effects have failed a gate, the last of some results, and what replaced them."""
        others = tuple(dict.fromkeys(term.effect_joint for term in instead))
        for term in terms:
            if term.named:
                before = self._met.get(term.effect_joint, {})
                self._met[term.effect_joint] = before | {result.gate: result for result in results}
                self._instead[term.effect_joint] = others

    def forked(self) -> Record:
        """A copy for a trial whose decisions may be discarded."""
        out = Record()
        out._met = {cause: dict(results) for cause, results in self._met.items()}
        out._instead = dict(self._instead)
        return out

    def take(self, other: Record) -> None:
        """Take over the decisions of a trial."""
        self._met, self._instead = other._met, other._instead

    @property
    def claimed(self) -> tuple[EffectJoint, ...]:
        """All effects and joints that were claimed at any time, in the order of their first claim."""
        return tuple(self._met)

    def met(self, cause: EffectJoint) -> tuple[GateResult, ...]:
        """Last result of each gate that an effect met."""
        return tuple(self._met.get(cause, {}).values())

    def instead(self, cause: EffectJoint) -> tuple[EffectJoint, ...]:
        """Effects that replaced an effect; empty if none did."""
        return self._instead.get(cause, ())
