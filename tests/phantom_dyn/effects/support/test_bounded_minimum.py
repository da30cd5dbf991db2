"""The least value between two bounds, against closed forms and scipy.optimize, whose import a command does without."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from phantom_dyn.effects.support.bounded_minimum import bounded_minimum


@pytest.mark.parametrize("place", [-1.0, -0.3, 0.0, 0.77, 2.0])
def test_the_lowest_point_of_a_parabola_is_found(place):
    assert bounded_minimum(lambda x: (x - place) ** 2, -1.0, 2.0, 1e-6) == pytest.approx(place, abs=2e-6)


@pytest.mark.parametrize("law", [lambda x: np.cosh(x - 1.3), lambda x: abs(x - 0.4) ** 1.5, np.cos, lambda x: x])
def test_the_place_is_that_of_scipy_with_as_many_evaluations(law):
    asked = []
    wanted = minimize_scalar(law, bounds=(0.0, 5.0), method="bounded", options={"xatol": 1e-5})
    found = bounded_minimum(lambda x: (asked.append(x), law(x))[1], 0.0, 5.0, 1e-5)
    assert found == pytest.approx(wanted.x, abs=1e-9)
    assert len(asked) == wanted.nfev
