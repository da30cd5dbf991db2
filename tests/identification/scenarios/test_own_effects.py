from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identification.diagnosis.columns.own_effects import OwnEffect, changed_effects
from identification.diagnosis.result import Value
from identification.scenarios.known_changes import growth
from phantom_dyn.effects.catalogue import EFFECTS, effect_named
from phantom_dyn.effects.operation import Operation

CHANGING = sorted(effect.name for effect in EFFECTS if effect.changes_with is not None)


@pytest.mark.parametrize("name", CHANGING)
def test_an_effect_of_one_recording_leaves_nothing_in_the_others(pendulum, swing, name):
    # Known truth: the effect itself in its recording, zero elsewhere.
    inner = effect_named(name)
    effect = OwnEffect(inner, 1, "b.csv")
    here = replace(Operation.of(pendulum, swing(1)), recording=1)
    # Friction over position is tried where a residual asks for it: a place from end to end then.
    shape = next(iter(inner.shapes(pendulum, here, "pin")), (-0.5, 0.5, 5.0))
    wanted = inner.signature(pendulum, here, "pin", shape)
    np.testing.assert_array_equal(effect.signature(pendulum, here, "pin", shape).columns, wanted.columns)
    assert not effect.signature(pendulum, replace(here, recording=0), "pin", shape).columns.any()


def test_names_of_effects_are_those_of_their_recordings():
    names = {
        OwnEffect(effect_named(name), k, "x.csv").name
        for name in ("viscous_friction", "coulomb_friction")
        for k in (0, 1)
    }
    assert len(names | {"viscous_friction", "coulomb_friction"}) == 6


def test_a_ratio_is_the_level_here_over_that_elsewhere():
    # Closed form: independent levels 1.0 +- 0.1 and 1.9 +- 0.1, whose difference is 0.9 +- sqrt(2) 0.1.
    ratio = growth(Value(0.9, 0.1 * np.sqrt(2), "N m"), Value(1.0, 0.1, "N m"))
    assert ratio is not None
    assert ratio.value == pytest.approx(1.9)
    assert ratio.std == pytest.approx(0.1 * np.hypot(1.0, 1.9))


def test_nothing_elsewhere_gives_no_ratio():
    assert growth(Value(0.9, 0.1, "N m"), Value(0.0, 0.0, "N m")) is None


def test_temperature_changes_friction_too(pendulum):
    # Oracle: what each effect of the catalogue says of itself.
    changed = {kind: {one.name for one in changed_effects(kind, pendulum)} for kind in ("friction", "temperature")}
    said = {effect.name: effect.changes_with for effect in EFFECTS}
    assert changed["friction"] == {name for name, kind in said.items() if kind == "friction"}
    assert changed["temperature"] == {name for name, kind in said.items() if kind in ("friction", "temperature")}
