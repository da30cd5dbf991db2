from __future__ import annotations

import dataclasses
import string

import pytest

from identification.diagnosis.result import EffectAt, Value
from identification.words.effect_words import meaning_of, size_words, value_cell
from phantom_dyn.effects.catalogue import EFFECTS


def test_every_effect_has_a_phrase_for_its_size():
    # Of inertial parameters there are as many as move.
    assert {effect.name for effect in EFFECTS if not effect.words.size} == {"inertial_parameters"}


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)
def test_every_parameter_of_the_catalogue_has_a_meaning(effect, planar2):
    names = [parameter.name for parameter in effect.parameters(planar2, effect.places(planar2)[0])]
    assert names
    assert [name for name in names if not meaning_of(EffectAt(effect.name, None), name)] == []


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)
def test_the_phrase_of_a_size_uses_parameters_of_its_effect(effect):
    fields = {name for _, name, _, _ in string.Formatter().parse(effect.words.size) if name}
    assert fields <= set(effect.words.parameters)


def test_a_size_has_three_digits_and_its_unit(made_up):
    assert size_words(made_up().findings[0]) == "of 0.251 N m"


def test_a_list_is_told_entry_by_entry(made_up):
    assert size_words(made_up(findings=3).findings[2]) == "of 0.02 and 0.004 N m, 6 and 12 times a turn"


def test_a_finding_without_the_parameters_of_its_law_has_no_size(made_up):
    assert size_words(dataclasses.replace(made_up().findings[0], parameters={})) == ""


def test_an_angle_is_shown_in_degrees_too():
    # Closed form: pi / 180.
    shown = value_cell(Value(0.01745329, 0.0001, "rad")).replace("\N{NO-BREAK SPACE}", " ")
    assert shown == "0.01745 ± 0.00010 rad (1°)"


def test_a_body_parameter_is_told_by_its_quantity():
    assert (
        meaning_of(EffectAt("inertial_parameters", None), "wrist.link.mx")
        == "mass times the place of its centre along x"
    )


def test_a_number_never_parts_from_its_unit_in_a_table():
    assert " " not in value_cell(Value(0.25, 0.01, "N m s/rad"))
    assert value_cell(Value([1.0, 2.0], [0.1, 0.1], "N m")).count(" ") == 1
