"""Programs of one shape with other numbers. Oracle: a projection onto a half-space in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from identification.estimators.consistent.stated_program import Shape, Values, stated

SHAPE = Shape(unknowns=3, bodies=(), inequalities=1)


def half_space(normal, least) -> Values:
    """The point nearest to the origin with ``normal @ u >= least``."""
    none = np.zeros((0, 16, 3)), np.zeros((0, 4, 4)), np.zeros((0, 4, 4))
    return Values(np.array([normal]), np.array([least]), *none)


@pytest.mark.parametrize(("normal", "least"), [([1.0, 0.0, 0.0], 2.0), ([3.0, 0.0, 4.0], 10.0)])
def test_the_numbers_are_those_of_the_call(normal, least):
    at, forces, _, status = stated(SHAPE).solved(half_space(normal, least), 1e-10)
    wanted = least * np.array(normal) / np.dot(normal, normal)
    np.testing.assert_allclose(at, wanted, atol=1e-8)
    np.testing.assert_allclose(forces, least / np.dot(normal, normal), rtol=1e-6)
    assert status == "optimal"


def test_what_was_solved_before_leaves_no_trace():
    # Oracle: the same call again; a solver that begins at the last solution ends at other digits.
    first = stated(SHAPE).solved(half_space([1.0, 2.0, 3.0], 1.0), 1e-7)[0]
    stated(SHAPE).solved(half_space([-5.0, 0.5, 1.0], 7.0), 1e-7)
    np.testing.assert_array_equal(stated(SHAPE).solved(half_space([1.0, 2.0, 3.0], 1.0), 1e-7)[0], first)


def test_a_shape_is_stated_once():
    assert stated(SHAPE) is stated(Shape(3, (), 1))
