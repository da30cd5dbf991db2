"""Checks of numbers: what is refused is one sentence with the name of the number and its owner."""

from __future__ import annotations

import math

import pytest

from phantom_dyn.errors import ParameterError
from phantom_dyn.number_checks import require_not_negative, require_positive


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_a_number_that_is_not_above_zero_is_refused_by_name_and_owner(value):
    with pytest.raises(ParameterError, match=rf"^The rod mass of the rods is {value}: give a number above 0\.$"):
        require_positive("the rods", length=1.0, rod_mass=value)


@pytest.mark.parametrize("value", [-1e-9, math.nan, math.inf])
def test_a_number_below_zero_is_refused_without_an_owner(value):
    require_not_negative(delay=0.0)
    with pytest.raises(ParameterError, match=rf"^The delay is {value}: give a number of 0 or more\.$"):
        require_not_negative(delay=value)
