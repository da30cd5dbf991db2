"""The laparoscopic workstation. Oracle: its published table, in degrees and millimetres."""

from __future__ import annotations

import math

import numpy as np
import pytest

from phantom_dyn.haptics.cheap.cheap_hardware import rendered
from phantom_dyn.haptics.cheap.workstation import WORKSTATION


def test_a_rotary_axis_is_in_radians():
    pitch = WORKSTATION["pitch"]
    assert pitch.resolution == pytest.approx(0.01 * math.pi / 180)
    assert pitch.travel == pytest.approx(100 * math.pi / 180)


def test_the_insertion_is_in_metres():
    assert (WORKSTATION["insertion"].travel, WORKSTATION["insertion"].resolution) == (0.170, 8e-6)


@pytest.mark.parametrize(("name", "held"), [("insertion", 11.0), ("handle grip", 0.15), ("tip twist", 0.0)])
def test_a_motor_holds_its_continuous_force(name, held):
    t = np.arange(10) / 1000.0
    out = rendered(WORKSTATION[name].motor, t, 0 * t, np.full(10, 50.0))
    np.testing.assert_allclose(out.force, held)
