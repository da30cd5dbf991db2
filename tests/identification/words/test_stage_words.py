"""Words of the stages. Oracle: by hand."""

from __future__ import annotations

import pytest

from identification.stages import Announcement, Stage
from identification.words.stage_words import NAMES, in_words, stage_words


def test_every_stage_has_words_of_its_own():
    assert (set(NAMES), len(set(NAMES.values()))) == (set(Stage), len(Stage))


@pytest.mark.parametrize(
    ("now", "words"),
    [
        (Announcement(Stage.FILTERING), "filtering"),
        (Announcement(Stage.READING, detail={"file": "log.csv"}), "reading log.csv"),
        (Announcement(Stage.RIVALS_TRIED, detail={"found": 2}), "trying rivals, 2 found"),
        (Announcement(Stage.ESTIMATION, detail={"estimator": "wls"}), "estimating (wls)"),
        (Announcement(Stage.MAP, 20, 80), "mapping 20 of 80 points"),
        (Announcement(Stage.SIMULATION, 1, 3), "simulating stretch 1 of 3"),
        (Announcement(Stage.BATCH, 0, 2), "diagnosed 0 of 2 recordings"),
        (Announcement(Stage.BATCH, 1, 2, {"file": "a.csv"}), "diagnosed 1 of 2, last a.csv"),
        (
            Announcement(Stage.DESCENT, 1, 8, {"cost": 1.23456, "excess": 0.005}),
            "round 1 of 8: cost 1.235, limits exceeded by 0.5 %",
        ),
    ],
)
def test_words_of_an_announcement(now, words):
    assert stage_words(now) == words


def test_a_callback_that_takes_a_text_is_given_the_words():
    told: list[str] = []
    in_words(told.append)(Announcement(Stage.NOISE))
    assert told == ["estimating the noise"]
