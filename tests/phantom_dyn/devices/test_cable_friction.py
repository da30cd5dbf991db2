"""Friction proportional to the pretension of a cable: closed forms, and the assumption of the CEA paper."""

from __future__ import annotations

import numpy as np
import pytest

from phantom_dyn.devices.cable_friction import CableFriction, rescaled
from phantom_dyn.errors import ParameterError

PULLED = np.array([20.0, 40.0, 80.0])


def test_coulomb_and_stiction_are_linear_in_the_pretension():
    law = CableFriction(3e-3, static_ratio=1.1)
    np.testing.assert_allclose(law.coulomb(PULLED), [0.06, 0.12, 0.24], rtol=1e-12)
    np.testing.assert_allclose(law.stiction(PULLED), [0.066, 0.132, 0.264], rtol=1e-12)


def test_the_torque_is_along_the_velocity_and_nothing_at_rest():
    torque = CableFriction(3e-3).torque(PULLED, np.array([-1.0, 0.0, 0.2]))
    np.testing.assert_allclose(torque, [-0.06, 0.0, 0.24], rtol=1e-12)


def test_the_published_torque_halves_with_the_pretension():
    """Table 3: 0.120 N m; section V.B: linear in the pretension."""
    assert rescaled(0.120, pretension=40.0, new_pretension=20.0) == pytest.approx(0.060, rel=1e-12)


def test_a_slack_cable_is_refused():
    with pytest.raises(ParameterError, match=r"Pretension number 1 is 0 N.* a slack cable drives nothing"):
        CableFriction(3e-3).coulomb(np.array([10.0, 0.0]))


@pytest.mark.parametrize(("arguments", "words"), [((0.0,), "per pretension is 0"), ((1.0, 0.9), "give 1 or more")])
def test_a_law_that_cannot_be_is_refused(arguments, words):
    with pytest.raises(ParameterError, match=words):
        CableFriction(*arguments)


def test_rescaling_from_nothing_is_refused():
    with pytest.raises(ParameterError, match="The pretension is 0"):
        rescaled(0.1, pretension=0.0, new_pretension=1.0)
