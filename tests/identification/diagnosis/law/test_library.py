"""Terms of the library of formulas that effects of the catalogue say. Oracle: what the effects and the test write."""

import numpy as np
import pytest

from identification.diagnosis.law import terms
from identification.diagnosis.law.terms import library
from phantom_dyn.effects.catalogue import EFFECTS
from phantom_dyn.effects.described import FormulaTerm
from phantom_dyn.effects.friction.viscous_friction import ViscousFriction
from rests import made_up_rest

REST = made_up_rest(lambda x: 0.0 * x["t"], seconds=9.0)
# Of what the made-up recording has; it is without temperatures.
SAID = [
    (effect.name, term.text)
    for effect in EFFECTS
    for term in effect.formula(lambda kind: 0.0)
    if "temp" not in term.text
]  # fmt: skip


class Windage(ViscousFriction):
    name = "windage"

    def __init__(self, kind: str, text: str, power: int):
        self.said = FormulaTerm(kind, text, lambda v: np.sign(v) * np.abs(v) ** power, "{speed}^" + str(power))

    def formula(self, middle):
        return (self.said,)


@pytest.mark.parametrize("text", [text for _, text in SAID if "(q" not in text])
def test_what_an_effect_says_is_in_the_library_once(text):
    assert [term.texts for term in library(REST)].count((text,)) == 1


def test_an_effect_that_joins_the_catalogue_joins_the_library(monkeypatch):
    before = library(REST)
    monkeypatch.setattr(terms, "EFFECTS", (*EFFECTS, Windage("windage", "v^3", 3)))
    after = library(REST)
    (new,) = [term for term in after if term.kind == "windage"]
    assert (new.texts, new.inputs, new.per) == (("v^3",), frozenset({"v.j1"}), "(rad/s)^3")
    np.testing.assert_allclose(new.columns[0](REST.logs[0]), REST.logs[0].inputs["v.j1"] ** 3)
    assert [term.texts for term in after if term is not new] == [term.texts for term in before]


def test_a_term_that_is_listed_is_the_effects_own_where_one_says_it(monkeypatch):
    before = library(REST)
    monkeypatch.setattr(terms, "EFFECTS", (*EFFECTS, Windage("windage", "v*|v|", 2)))
    after = library(REST)
    assert [term.kind for term in after if term.texts == ("v*|v|",)] == ["windage"]
    assert len(after) == len(before)


def test_a_term_about_a_place_is_about_the_middle_of_the_travel():
    # By hand: half way between the first and the last per cent of the positions.
    q = REST.logs[0].inputs["q.j1"]
    middle = float(f"{0.5 * sum(np.percentile(q, [1, 99])):.3g}")
    (spring,) = [term for term in library(REST) if term.kind == "spring"]
    np.testing.assert_allclose(spring.columns[0](REST.logs[0]), q - middle)
