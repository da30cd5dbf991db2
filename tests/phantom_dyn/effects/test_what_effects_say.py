"""How much an effect may say of itself. Oracle: the classes themselves."""

from __future__ import annotations

import pytest

from phantom_dyn.effects.catalogue import EFFECTS
from phantom_dyn.effects.effect import Effect
from phantom_dyn.effects.rival import Rival

OPTIONAL = [name for base in (Rival, Effect) for name in base.__annotations__ if hasattr(base, name)]


def test_an_effect_may_say_ten_things_of_itself_at_most():
    # Whatever is true of one effect alone is better a method of its own, or a row of the table of relations.
    assert 0 < len(OPTIONAL) <= 10


@pytest.mark.parametrize("attribute", OPTIONAL)
def test_what_an_effect_may_say_is_said_by_several(attribute):
    assert sum(attribute in vars(type(effect)) for effect in EFFECTS) > 1
