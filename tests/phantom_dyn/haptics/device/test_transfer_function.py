"""Rational transfer functions and their state space."""

from __future__ import annotations

import numpy as np
import pytest

from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.device.published import PHANTOM_1_5_X, PHANTOM_1_5_Y, PHANTOM_1_5_Z
from phantom_dyn.haptics.device.transfer_function import TransferFunction


@pytest.mark.parametrize("axis", [PHANTOM_1_5_X, PHANTOM_1_5_Y, PHANTOM_1_5_Z], ids="xyz")
def test_state_space_has_the_same_response(axis):
    # Oracle: the fraction itself.
    w = 2 * np.pi * np.array([1.0, 30.0, 100.0, 400.0])
    s = axis.state_space
    answers = [s.C @ np.linalg.solve(1j * f * np.eye(len(s.B)) - s.A, s.B) + s.D for f in w]
    np.testing.assert_allclose(answers, axis.response(w), rtol=1e-9)


def test_a_mount_that_gives_adds_its_compliance():
    axis = PHANTOM_1_5_X.plus(0.5)
    w = np.array([10.0, 500.0])
    np.testing.assert_allclose(axis.response(w), PHANTOM_1_5_X.response(w) + 0.5, rtol=1e-12)


def test_it_is_its_own_transfer_function():
    assert PHANTOM_1_5_X.transfer_function is PHANTOM_1_5_X


def test_a_numerator_of_higher_degree_is_refused():
    with pytest.raises(ParameterError, match="degree 2 over 1 was given: no device answers"):
        TransferFunction(np.array([1.0, 0.0, 0.0]), np.array([1.0, 1.0]))


def test_a_leading_zero_is_refused():
    with pytest.raises(ParameterError, match=r"denominator of a transfer function is \[0\.0, 1\.0\]: give finite"):
        TransferFunction(np.array([1.0]), np.array([0.0, 1.0]))
