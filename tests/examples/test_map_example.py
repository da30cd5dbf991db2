"""The example of maps runs. Oracle: the published values that it prints."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from called_example import printed as printed_by

pytestmark = pytest.mark.whole


@pytest.fixture(scope="module")
def printed(tmp_path_factory):
    """What the example prints, and the folder that it writes to."""
    folder = tmp_path_factory.mktemp("maps")
    return printed_by("phantom_maps.py", folder), folder


def test_it_prints_the_largest_manipulability(printed):
    assert "largest manipulability 0.7906976744, published lengths say 34/43 = 0.7906976744" in printed[0]


def test_it_prints_the_apparent_mass_at_the_origin(printed):
    # Published parameters.
    assert "apparent mass at the origin: 77.306 g, 52.491 g, 32.245 g" in printed[0]


def test_the_files_that_it_names_are_there(printed):
    named = re.findall(r"^wrote (.*)$", printed[0], flags=re.MULTILINE)
    assert len(named) == 6
    assert all(Path(name).is_file() for name in named)
