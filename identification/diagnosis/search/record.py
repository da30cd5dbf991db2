"""Record of the gates that each effect passed or failed, in search and judge.

The ledger of a diagnosis is made from it: all effects that were claimed at any time, with the results of the gates.
"""

from __future__ import annotations

from collections.abc import Iterable

from identification.diagnosis.columns.terms import Term
from identification.engine.claims import GateResult

EffectJoint = tuple[str, str | None]
"""Name of an effect and its joint; None for the whole robot."""
Cause = tuple[EffectJoint, ...]
"""Effects that together may explain what a finding explains; empty for the finding itself."""


class Record:
    """Decisions on effects: one entry for each effect and joint, with the last result of each gate.

    All shapes of a law share one entry. Structures without a name get no entry, but may be recorded as replacements.
    """

    def __init__(self) -> None:
        self._results: dict[EffectJoint, dict[str, GateResult]] = {}
        self._replacements: dict[EffectJoint, tuple[EffectJoint, ...]] = {}

    def add_passed(self, terms: Iterable[Term], *results: GateResult) -> None:
        """Record that effects have passed gates, and delete their earlier failures."""
        for term in terms:
            if term.named:
                before = self._results.get(term.effect_joint, {})
                passed = {name: result for name, result in before.items() if result.passed}
                self._results[term.effect_joint] = passed | {result.gate: result for result in results}
                self._replacements.pop(term.effect_joint, None)

    def add_failed(self, terms: Iterable[Term], *results: GateResult, replaced_by: Iterable[Term] = ()) -> None:
        """Record that effects have failed the gate of the last result, and which effects replaced them."""
        others = tuple(dict.fromkeys(term.effect_joint for term in replaced_by))
        for term in terms:
            if term.named:
                before = self._results.get(term.effect_joint, {})
                self._results[term.effect_joint] = before | {result.gate: result for result in results}
                self._replacements[term.effect_joint] = others

    def copy_for_trial(self) -> Record:
        """A copy for a trial whose decisions may be discarded."""
        out = Record()
        out._results = {effect_joint: dict(results) for effect_joint, results in self._results.items()}
        out._replacements = dict(self._replacements)
        return out

    def take_over(self, other: Record) -> None:
        """Take over the decisions of a trial."""
        self._results, self._replacements = other._results, other._replacements

    @property
    def claimed(self) -> tuple[EffectJoint, ...]:
        """All effects and joints that were claimed at any time, in the order of their first claim."""
        return tuple(self._results)

    def results_of(self, effect_joint: EffectJoint) -> tuple[GateResult, ...]:
        """Last result of each gate that was applied to an effect."""
        return tuple(self._results.get(effect_joint, {}).values())

    def replacements_of(self, effect_joint: EffectJoint) -> tuple[EffectJoint, ...]:
        """Effects that replaced an effect; empty if none did."""
        return self._replacements.get(effect_joint, ())
