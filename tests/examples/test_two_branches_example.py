"""The example of the device of two branches, held against what the CEA paper says of branches, rods and cables."""

from __future__ import annotations

import re

import pytest

from called_example import printed
from places import CHECKOUT

pytestmark = pytest.mark.whole


@pytest.fixture(scope="module")
def out(tmp_path_factory) -> str:
    return printed("cea_two_branches.py", tmp_path_factory.mktemp("two"))


def test_it_counts_the_parameters_of_both_branches(out):
    assert "58 inertial base parameters: 21 of each branch" in out


def test_it_moves_within_the_published_workspace(out):
    """Published: more than 200 mm in translation in any direction."""
    found = re.search(r"moved within (\d+) x (\d+) x (\d+) mm", out)
    assert found
    assert min(map(int, found.groups())) > 200


def test_its_platform_turns_by_more_than_is_published(out):
    """Published: over 150 degrees about any axis. A universal joint has half a turn between its singularities."""
    found = re.search(r"the platform turns by (\d+) degrees about x, (\d+) degrees about z", out)
    assert found
    assert [int(angle) for angle in found.groups()] == [180, 360]


def test_each_rod_has_one_parameter(out):
    """Published: one parameter per rod."""
    assert re.findall(r"^  (?:no|one|both) rods?.*? (\d+)$", out, flags=re.MULTILINE) == ["22", "23", "24", "22"]


def test_the_page_states_the_mass_that_is_printed(out):
    found = re.search(r"apparent mass ([\d.]+ to [\d.]+ kg)", out)
    assert found
    assert f"{found[1]} at the handle" in " ".join((CHECKOUT / "docs" / "haptics.md").read_text().split())


def test_friction_is_found_proportional_to_the_pretension(out):
    assert "proportional True" in out


def test_maps_are_written_where_the_output_says(out):
    assert re.search(r"^wrote .*apparent_mass\.png$", out, flags=re.MULTILINE)
