"""Record of the gates that each effect passed or failed in search and judge, from which the ledger is made."""

from __future__ import annotations

from collections.abc import Iterable

from identification.diagnosis.columns.terms import Term
from identification.engine.claims import GateResult

# An effect and its joint.
Place = tuple[str, str | None]


class Record:
    """Decisions on effects, by effect and joint for all shapes together; of each gate the last result counts.

    Structures without a name have no entries of their own; they may be what replaced an effect.
    """

    def __init__(self) -> None:
        self._met: dict[Place, dict[str, GateResult]] = {}
        self._instead: dict[Place, tuple[Place, ...]] = {}

    def kept(self, terms: Iterable[Term], *results: GateResult) -> None:
        """Record that effects have passed gates; earlier failures are cancelled."""
        for term in terms:
            if term.named:
                before = self._met.get(term.place, {})
                passed = {name: result for name, result in before.items() if result.passed}
                self._met[term.place] = passed | {result.gate: result for result in results}
                self._instead.pop(term.place, None)

    def lost(self, terms: Iterable[Term], *results: GateResult, instead: Iterable[Term] = ()) -> None:
        """Record that effects have failed a gate, the last of some results, and what replaced them."""
        others = tuple(dict.fromkeys(term.place for term in instead))
        for term in terms:
            if term.named:
                before = self._met.get(term.place, {})
                self._met[term.place] = before | {result.gate: result for result in results}
                self._instead[term.place] = others

    def forked(self) -> Record:
        """A copy for a trial whose decisions may be discarded."""
        out = Record()
        out._met = {place: dict(results) for place, results in self._met.items()}
        out._instead = dict(self._instead)
        return out

    def take(self, other: Record) -> None:
        """Take over the decisions of a trial."""
        self._met, self._instead = other._met, other._instead

    @property
    def places(self) -> tuple[Place, ...]:
        """All effects and joints that were claimed at any time, in the order of their first claim."""
        return tuple(self._met)

    def met(self, place: Place) -> tuple[GateResult, ...]:
        """Last result of each gate that an effect met."""
        return tuple(self._met.get(place, {}).values())

    def instead(self, place: Place) -> tuple[Place, ...]:
        """Effects that replaced an effect; empty if none did."""
        return self._instead.get(place, ())
