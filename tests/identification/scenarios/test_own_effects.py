from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identification.diagnosis.model.own_effects import EFFECTS_OF, own_effect
from identification.diagnosis.result import Value
from identification.scenarios.known_changes import growth
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.operation import Operation


@pytest.mark.parametrize("name", sorted({name for names in EFFECTS_OF.values() for name in names}))
def test_an_effect_of_one_recording_leaves_nothing_in_the_others(pendulum, swing, name):
    # Known truth: the effect itself in its recording, zero elsewhere.
    effect, inner = own_effect(name, 1, "b.csv"), effect_named(name)
    here = replace(Operation.of(pendulum, swing(1)), recording=1)
    shape = inner.shapes(pendulum, here, "pin")[0]
    wanted = inner.signature(pendulum, here, "pin", shape)
    np.testing.assert_array_equal(effect.signature(pendulum, here, "pin", shape).columns, wanted.columns)
    assert not effect.signature(pendulum, replace(here, recording=0), "pin", shape).columns.any()


def test_names_of_effects_are_those_of_their_recordings():
    names = {own_effect(name, k, "x.csv").name for name in ("viscous_friction", "coulomb_friction") for k in (0, 1)}
    assert len(names | {"viscous_friction", "coulomb_friction"}) == 6


def test_a_ratio_is_the_level_here_over_that_elsewhere():
    # Closed form: independent levels 1.0 +- 0.1 and 1.9 +- 0.1, whose difference is 0.9 +- sqrt(2) 0.1.
    ratio = growth(Value(0.9, 0.1 * np.sqrt(2), "N m"), Value(1.0, 0.1, "N m"))
    assert ratio is not None
    assert ratio.value == pytest.approx(1.9)
    assert ratio.std == pytest.approx(0.1 * np.hypot(1.0, 1.9))


def test_nothing_elsewhere_gives_no_ratio():
    assert growth(Value(0.9, 0.1, "N m"), Value(0.0, 0.0, "N m")) is None
