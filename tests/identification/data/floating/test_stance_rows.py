"""What stance would add. Oracle: rows counted by hand on a leg of two joints that stands half of the time."""

from __future__ import annotations

import pytest

from floating_leg import log_of_leg, written_leg
from identification.data.floating.stance_rows import stance_words
from identification.data.reading import recording
from identification.data.recording import Table
from phantom_dyn.model.loading import load_robot


@pytest.fixture
def said(tmp_path, rng):
    """The sentence on a leg, which stands by turns or hangs."""
    robot = load_robot(written_leg(tmp_path))

    def words(*, steps: bool) -> str:
        log = log_of_leg(tmp_path / "robot.urdf", rng, steps=steps)
        return stance_words(recording(Table("log.csv", log), robot), robot)

    return words


def test_rows_of_the_base_less_three_of_the_foot_are_added_while_it_stands(said):
    # By hand: of 6 rows of the base and 2 of the leg a point takes 3, half of the time; else its 2 joints are free.
    words = said(steps=True)
    assert words.startswith("log.csv: 2.5 rows a sample hold")
    assert "beside 1.0 of joints that touch nothing" in words


def test_a_leg_that_hangs_gains_nothing(said):
    assert said(steps=False) == "log.csv: stance adds nothing, as nothing touches the ground."
