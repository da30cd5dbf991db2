from __future__ import annotations

import pytest

from phantom_dyn.haptics.cheap.cheap_cycle import coupling_force, side_of


@pytest.mark.parametrize(("apart", "side"), [(0.6e-3, 1.0), (0.4e-3, 0.0), (-0.4e-3, 0.0), (-0.6e-3, -1.0)])
def test_the_probe_presses_the_wall_that_it_is_beyond(apart, side):
    # Published: (1) of the seed, a gap of 1 mm.
    assert side_of(apart, 1e-3) == side


def test_without_a_gap_there_is_always_contact():
    assert {abs(side_of(apart, 0.0)) for apart in (-1e-3, 0.0, 1e-3)} == {1.0}


def test_the_spring_starts_at_the_wall_without_a_jump():
    # (2) is printed with a jump of K d/2, 0.3 N for 600 N/m and 1 mm; with the attachment of (1) it is continuous.
    assert coupling_force(0.5e-3, 0.0, 1.0, 1e-3, 600.0, 0.0) == 0.0
    assert coupling_force(0.6e-3, 0.0, 1.0, 1e-3, 600.0, 0.0) == pytest.approx(-600.0 * 0.1e-3)


def test_in_the_gap_a_fifth_of_the_damping_acts_between_probe_and_mass():
    # Published: B1 = 0.2 B2.
    assert coupling_force(0.0, 0.3, 0.0, 1e-3, 600.0, 10.0) == pytest.approx(-0.2 * 10.0 * 0.3)
