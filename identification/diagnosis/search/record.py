"""What search and judge have decided of each effect, and by which gates; the ledger of a diagnosis is made of it."""

from __future__ import annotations

from collections.abc import Iterable

from identification.diagnosis.columns.terms import Term
from identification.engine.claims import GateResult

# An effect and its joint.
Place = tuple[str, str | None]


class Record:
    """Decisions on the effects of a catalogue, by effect and joint whatever the shape; of a gate the last one counts.

    Structures without a name are not recorded as claims, as nobody can ask for them; they may be what took a place.
    """

    def __init__(self) -> None:
        self._met: dict[Place, dict[str, GateResult]] = {}
        self._instead: dict[Place, tuple[Place, ...]] = {}

    def kept(self, terms: Iterable[Term], *results: GateResult) -> None:
        """Write down that effects have passed gates; what they failed before counts no more."""
        for term in terms:
            if term.named:
                before = self._met.get(term.place, {})
                passed = {name: result for name, result in before.items() if result.passed}
                self._met[term.place] = passed | {result.gate: result for result in results}
                self._instead.pop(term.place, None)

    def lost(self, terms: Iterable[Term], *results: GateResult, instead: Iterable[Term] = ()) -> None:
        """Write down that effects have failed a gate, the last of some results, and what took their place."""
        others = tuple(dict.fromkeys(term.place for term in instead))
        for term in terms:
            if term.named:
                before = self._met.get(term.place, {})
                self._met[term.place] = before | {result.gate: result for result in results}
                self._instead[term.place] = others

    def forked(self) -> Record:
        """A copy for a trial, which may be thrown away."""
        out = Record()
        out._met = {place: dict(results) for place, results in self._met.items()}
        out._instead = dict(self._instead)
        return out

    def take(self, other: Record) -> None:
        """Go on from what a trial has decided."""
        self._met, self._instead = other._met, other._instead

    @property
    def places(self) -> tuple[Place, ...]:
        """All effects and joints that were claimed at any time, in the order in which they came."""
        return tuple(self._met)

    def met(self, place: Place) -> tuple[GateResult, ...]:
        """Last result of each gate that an effect met."""
        return tuple(self._met.get(place, {}).values())

    def instead(self, place: Place) -> tuple[Place, ...]:
        """What took the place of an effect; empty if nothing did."""
        return self._instead.get(place, ())
