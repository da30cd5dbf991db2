"""Words for effects, their sizes and the regimes of motion in which they show."""

from __future__ import annotations

import math
import string
from typing import Protocol

from identification.diagnosis.result import Finding, Value
from identification.words.numbers_and_names import NO_BREAK, number, value_words, with_unit
from phantom_dyn.effects.catalogue import kind_and_place, known_effect
from phantom_dyn.effects.described import EffectWords

# Reports list kinds of effects in this order, and effects of one kind in the order of the catalogue.
_KINDS = ("friction", "transmission", "drive", "load", "encoder")

REGIMES: dict[str, str] = {
    "velocity_reversal": "where the velocity changes sign",
    "low_speed": "at low speed",
    "high_speed": "at high speed",
    "high_load": "under high load",
    "high_acceleration": "at high acceleration",
    "one_direction": "in one direction of motion",
    "periodic_in_angle": "repeating with the joint angle",
    "posture": "in some postures more than in others",
    "saturated": "where the torque is at its limit",
    "time_drift": "drifting over time",
    "everywhere": "throughout the motion",
}

# Inertial parameters of a body, in the frame of the joint that moves it; a name is BODY.QUANTITY.
INERTIAL: dict[str, str] = {
    "m": "mass",
    **{f"m{a}": f"mass times the place of its centre along {a}" for a in "xyz"},
    **{f"I{a}{a}": f"moment of inertia about {a}" for a in "xyz"},
    **{f"I{a}{b}": f"product of inertia in {a} and {b}" for a, b in ("xy", "xz", "yz")},
}


class Named(Protocol):
    """An object that names an effect: a finding, a part of a rival, a bound, or an effect that is not testable."""

    @property
    def effect(self) -> str:
        """Name of the effect."""
        ...

    @property
    def words(self) -> EffectWords | None:
        """Words of a user's effect; None for an effect of the catalogue."""
        ...


def words_of(named: Named) -> EffectWords:
    """Words for an effect: for a user's effect the user's words, else those of the catalogue."""
    return effect_words(named.effect) if named.words is None else named.words


def effect_words(effect: str) -> EffectWords:
    """Words for an effect of the catalogue; any other name is shown as it is."""
    known = known_effect(effect)
    if known is not None:
        return known.words
    return shown_as(effect.replace("_", " "))


def shown_as(name: str) -> EffectWords:
    """Words for an effect if only its name is known."""
    return EffectWords(name, name, "See what this effect means in its documentation.")


def report_order(effect: str) -> tuple[int, int]:
    """Sort key of an effect in a report: its kind, then its place in the catalogue; effects of a user come last."""
    kind, place = kind_and_place(effect) or ("", 0)
    return _KINDS.index(kind) if kind in _KINDS else len(_KINDS), place


def is_between_joints(effect: str) -> bool:
    """True if an effect of the catalogue acts between two joints."""
    known = known_effect(effect)
    return known is not None and known.scope == "pair"


def is_shared(effect: str) -> bool:
    """True if an effect of the catalogue may have one number on several joints."""
    known = known_effect(effect)
    return known is not None and known.shared


def regime_words(regime: str | None) -> str:
    """Words for a regime; empty for None."""
    return "" if regime is None else REGIMES.get(regime, regime.replace("_", " "))


def regime_sentence(regime: str | None) -> str:
    """``It shows at low speed.``; empty for None."""
    words = regime_words(regime)
    if not words:
        return ""
    verbs = {"repeating": "repeats", "drifting": "drifts"}
    verb, _, remainder = words.partition(" ")
    return f"It {verbs[verb]} {remainder}." if verb in verbs else f"It shows {words}."


def size_words(finding: Finding) -> str:
    """Size that follows a finding's name, such as ``of 0.051 N m``; empty if a parameter is missing."""
    template = words_of(finding).size
    fields = [name for _, name, _, _ in string.Formatter().parse(template) if name]
    if not fields or any(name not in finding.parameters or not finding.parameters[name].shown for name in fields):
        return ""
    return template.format(**{name: _shown(finding.parameters[name]) for name in fields})


def shortfall_words(value: Value) -> str:
    """How far a finding is below the modelled value, as ``by 0.051 N m``."""
    return f"by {with_unit(number(abs(value.numbers[0])), value.unit)}"


def meaning_of(named: Named, parameter: str) -> str:
    """Meaning of an effect's parameter; empty if its name says enough."""
    _, dot, quantity = parameter.rpartition(".")
    return INERTIAL.get(quantity, "") if dot else words_of(named).parameters.get(parameter, "")


def value_cell(value: Value) -> str:
    """A value for a table; for a single angle followed by the value in degrees."""
    shown = value_words(value).replace(" ", NO_BREAK).replace(f",{NO_BREAK}", ", ")
    if value.unit != "rad" or len(value.numbers) != 1 or not math.isfinite(value.numbers[0]):
        return shown
    return f"{shown}{NO_BREAK}({number(math.degrees(value.numbers[0]))}°)"


def _shown(value: Value) -> str:
    """A value in a sentence, without its standard deviation, which the table of sizes states."""
    return with_unit(" and ".join(map(number, value.numbers)), value.unit)
