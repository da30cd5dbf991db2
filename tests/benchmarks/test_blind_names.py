"""Names of effects in the sealed cases: each generator has a list of its own, which no code of ours made."""

from __future__ import annotations

import pytest

from benchmarks.gapbench.generator.effects import SINGLE_EFFECTS
from benchmarks.gapbench.makes.drake.effects import NAMES
from phantom_dyn.effects.catalogue import EFFECTS


@pytest.mark.parametrize("names", [SINGLE_EFFECTS, NAMES], ids=["MuJoCo", "Drake"])
def test_a_generator_calls_effects_as_the_catalogue_does(names):
    # Two independent lists; an effect that no generator draws yet is in the catalogue alone.
    assert set(names) - {effect.name for effect in EFFECTS} == set()
    assert len(set(names)) == len(names)


def test_the_generators_know_the_same_effects():
    assert set(NAMES) == set(SINGLE_EFFECTS)
