from __future__ import annotations

import numpy as np
import pytest

from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.cheap.cheap_axis import (
    CheapAxis,
    CoggingTorque,
    StickingFriction,
    VirtualMass,
    cheap_rotation,
    cheap_translation,
)


def test_the_columns_of_the_printed_table_stand_where_their_units_belong():
    # Published (Table 2, friction unswapped): 100 um and 5 mm/s for a translation, 5 mrad and 6 deg/s for a rotation.
    translation = cheap_translation(slip=1.0, order=600.0, limit=11.0).friction
    rotation = cheap_rotation(slip=0.05, order=20.0, limit=0.47).friction
    assert translation == StickingFriction(1.0, 100e-6, 5e-3, 1.05)
    assert rotation == StickingFriction(0.05, 5e-3, float(np.deg2rad(6.0)), 1.05)


def test_the_other_figures_are_those_of_the_table():
    translation = cheap_translation(slip=1.0, order=600.0, limit=11.0)
    rotation = cheap_rotation(slip=0.05, order=20.0, limit=0.47)
    assert (translation.gap, rotation.gap) == (1e-3, pytest.approx(np.deg2rad(2.0)))
    assert translation.mass == VirtualMass(0.1, 150.0)
    assert rotation.mass == VirtualMass(1e-3, 1.0)
    assert translation.cogging == CoggingTorque((600.0,), (0.6,), (0.0,))
    assert rotation.cogging == CoggingTorque((20.0,), (0.04,), (0.0,))


def test_the_period_of_the_mass_is_near_the_published_time_constant():
    # Published: T = 150 ms; 2 pi sqrt(M/K) is 162 ms at 0.1 kg and 150 N/m, 150 ms at 0.0855 kg.
    assert VirtualMass(0.1, 150.0).period == pytest.approx(0.162, abs=5e-4)
    assert VirtualMass(0.0855, 150.0).period == pytest.approx(0.150, abs=5e-4)
    assert VirtualMass(1e-3, 1.0).period == pytest.approx(0.199, abs=5e-4)


def test_damping_is_critical_unless_it_is_given():
    # Closed form: 2 sqrt(M K); the printed 0.05 would be 0.0065 of it in N s/m.
    assert VirtualMass(0.1, 150.0).damping == pytest.approx(7.746, abs=1e-3)
    assert VirtualMass(0.1, 150.0, 0.05).damping == 0.05
    assert pytest.approx(0.0065, abs=1e-4) == 0.05 / 7.746


def test_a_gap_without_a_mass_is_refused():
    with pytest.raises(ParameterError, match=r"a gap of 0.001 and no mass: a play is between two masses"):
        CheapAxis(gap=1e-3)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: VirtualMass(0.0, 1.0), "The inertia of a VirtualMass is 0: give more than 0"),
        (lambda: StickingFriction(-1.0, 1e-4, 5e-3), "The torque of a StickingFriction is -1: give 0 or more"),
        (lambda: CheapAxis(limit=-1.0), "The limit of a cheap axis is -1"),
        (lambda: CoggingTorque((1.0, 2.0), (0.1,), (0.0,)), "2 orders, 1 amplitudes and 1 phases"),
    ],
)
def test_impossible_numbers_are_refused_in_a_sentence(make, words):
    with pytest.raises(ParameterError, match=words):
        make()
