"""How large an effect is, in words: one phrase for the sentence of a finding, and what each parameter means."""

from __future__ import annotations

import math
import string

from identification.diagnosis.result import Finding, Value
from identification.words.effect_words import effect_words
from identification.words.numbers import NO_BREAK, number, value_words, with_unit

# Of a body, in the frame of the joint that moves it; a name is BODY.QUANTITY.
INERTIAL: dict[str, str] = {
    "m": "mass",
    **{f"m{a}": f"mass times the place of its centre along {a}" for a in "xyz"},
    **{f"I{a}{a}": f"moment of inertia about {a}" for a in "xyz"},
    **{f"I{a}{b}": f"product of inertia in {a} and {b}" for a, b in ("xy", "xz", "yz")},
}


def size_words(finding: Finding) -> str:
    """What follows a finding's name, as in ``of 0.051 N m``; empty where a parameter is missing."""
    template = effect_words(finding.effect).size
    fields = [name for _, name, _, _ in string.Formatter().parse(template) if name]
    if not fields or any(name not in finding.parameters for name in fields):
        return ""
    return template.format(**{name: _shown(finding.parameters[name]) for name in fields})


def shortfall_words(value: Value) -> str:
    """What follows the name of a finding that says there is less than modelled, as in ``by 0.051 N m``."""
    return f"by {with_unit(number(abs(_listed(value)[0])), value.unit)}"


def meaning_of(effect: str, parameter: str) -> str:
    """What a parameter of an effect means; empty where its name says it."""
    _, dot, quantity = parameter.rpartition(".")
    return INERTIAL.get(quantity, "") if dot else effect_words(effect).parameters.get(parameter, "")


def value_cell(value: Value) -> str:
    """A value for a table; a single angle in degrees as well."""
    shown = value_words(value).replace(" ", NO_BREAK).replace(f",{NO_BREAK}", ", ")
    if value.unit != "rad" or isinstance(value.value, list) or not math.isfinite(value.value):
        return shown
    return f"{shown}{NO_BREAK}({number(math.degrees(value.value))}°)"


def _shown(value: Value) -> str:
    """A value in a sentence, without its deviation: that is in the table of sizes."""
    return with_unit(" and ".join(number(v) for v in _listed(value)), value.unit)


def _listed(value: Value) -> list[float]:
    return value.value if isinstance(value.value, list) else [value.value]
