"""How far a run is in per cent: by the stages of each command, and the part of its time that each usually takes [%]."""

from __future__ import annotations

from collections.abc import Mapping

from identification.stages import Announcement, Stage

DIAGNOSIS = {
    Stage.READING: 16.0,
    Stage.FILTERING: 1.0,
    Stage.REGRESSORS: 12.0,
    Stage.NOISE: 20.0,
    Stage.CHANCE: 24.0,
    Stage.RIVALS_COMPARED: 20.0,
    Stage.BOUNDS: 1.0,
    Stage.LAW: 2.0,
    Stage.SIMULATION: 4.0,
}
"""Stages of ``phantom-dyn diagnose`` until its answer is known. Shares are rounded means over recordings of one to
seven joints; on any one of them rivals may take a small part or a large one (`python benchmarks/stage_shares.py`)."""

AFTER_DIAGNOSIS = {
    Stage.NEXT_EXPERIMENT: 17.0,
    Stage.WRITING: 83.0,
}
"""What follows its answer."""

IDENTIFICATION = {
    Stage.READING: 25.0,
    Stage.FILTERING: 5.0,
    Stage.IDENTIFIABILITY: 8.0,
    Stage.ESTIMATION: 10.0,
    Stage.HELD_OUT: 4.0,
    Stage.POSSIBLE_INERTIAS: 8.0,
    Stage.MODEL_FILES: 10.0,
    Stage.WRITING: 30.0,
}
"""Stages of ``phantom-dyn identify``. A short run takes most of its time to load libraries, a long one to estimate; so
of the next two."""

CHECK = {Stage.READING: 40.0, Stage.CHECKING: 60.0}
"""Stages of ``phantom-dyn check``, for each recording."""

EXCITATION = {
    Stage.LOADING: 20.0,
    Stage.POSTURES: 2.0,
    Stage.RANDOM_MOTIONS: 18.0,
    Stage.DESCENT: 58.0,
    Stage.WRITING: 2.0,
}
"""Stages of ``phantom-dyn excite``."""

MAP = {Stage.LOADING: 15.0, Stage.MAP: 35.0, Stage.WRITING: 30.0, Stage.DRAWING: 20.0}
"""Stages of ``phantom-dyn map``."""

VIEW = {
    Stage.LOADING: 30.0,
    Stage.FILTERING: 10.0,
    Stage.SIMULATION: 40.0,
    Stage.LINKS: 20.0,
}
"""Stages of ``phantom-dyn view``."""

BATCH = {Stage.LOADING: 1.0, Stage.BATCH: 98.0, Stage.WRITING: 1.0}
"""Stages of ``phantom-dyn diagnose`` with a table of recordings."""


def percent_done(stages: Mapping[Stage, float], now: Announcement) -> float:
    """Part of a run that is done at an announcement [%]; 0 if it is of no stage that counts.

    Args:
        stages: Of the run, in their order, with the part of its time that each takes [%].
        now: Where its parts are counted, those that are done count.
    """
    if now.stage not in stages:
        return 0.0
    before = sum(list(stages.values())[: list(stages).index(now.stage)])
    return before + stages[now.stage] * (min(now.done / now.of, 1.0) if now.of else 0.0)
