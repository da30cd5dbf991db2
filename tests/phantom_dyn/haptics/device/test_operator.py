"""The human operator: closed forms of a mass on a spring and a damper."""

from __future__ import annotations

import numpy as np
import pytest

from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.device.axis import YOKOKOHJI_YOSHIKAWA, Operator


def test_impedance_at_standstill_is_the_stiffness():
    assert Operator(2.0, 3.0, 10.0).impedance(np.array([0.0]))[0] == 10.0


def test_impedance_at_resonance_is_the_damper_alone():
    hand = Operator(2.0, 3.0, 50.0)
    resonance = 5.0  # rad/s, sqrt(50 / 2)
    np.testing.assert_allclose(hand.impedance(np.array([resonance])), [15j], rtol=1e-12, atol=1e-12)


def test_cited_operator_has_two_kilograms():
    np.testing.assert_array_equal(YOKOKOHJI_YOSHIKAWA.polynomial(), [2.0, 2.0, 10.0])


def test_negative_mass_is_refused():
    with pytest.raises(ParameterError, match=r"operator.s mass is -1\.0: give a number of 0 or more"):
        Operator(-1.0, 0.0, 0.0)
