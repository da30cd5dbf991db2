"""Recordings of which one fits the given model and another does not. Oracle: what was put into one of them."""

import numpy as np
import pytest

from identification.notes import Code
from identification.pipeline import diagnose


def unlike(diagnosis) -> list[dict]:
    return [dict(note.numbers) for note in diagnosis.notes if note.code is Code.RECORDINGS_UNLIKE]


@pytest.fixture(scope="module")
def rubbing(swing, recorded, pendulum):
    """A recording of the pendulum with friction that its model lacks, or less motion."""

    def make(seed: int, friction: float, file: str):
        motion = swing(seed)
        return recorded(pendulum, motion, friction * np.sign(motion.v), file, seed)

    return make


def test_where_one_of_two_recordings_fits_the_model_a_note_names_both(rubbing, pendulum):
    found = diagnose(pendulum, (rubbing(1, 0.0, "free.csv"), rubbing(2, 2.0, "rubs.csv")))
    assert found.verdict != "explained"
    assert unlike(found) == [{"fit": ("free.csv",), "misfit": ("rubs.csv",), "joints": ("pin",)}]
    # A cause in both recordings would show in both.
    assert max(one.probability for one in found.findings) <= 0.5


def test_where_both_have_the_gap_there_is_nothing_to_say(rubbing, pendulum):
    assert unlike(diagnose(pendulum, (rubbing(1, 2.0, "a.csv"), rubbing(2, 2.0, "b.csv")))) == []
