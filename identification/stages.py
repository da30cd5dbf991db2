"""Stages of a run, and the announcements that a ``progress`` callback is called with.

Percentages and times are counted by stage. `identification.words.stage_words` has the words that a user reads.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum, auto


class Stage(Enum):
    """Part of a run that takes time."""

    LOADING = auto()
    READING = auto()
    CHECKING = auto()
    FILTERING = auto()
    FITTING_POSES = auto()
    REGRESSORS = auto()
    NOISE = auto()
    CHANCE = auto()
    RIVALS_TRIED = auto()
    ALTERNATIVES = auto()
    NAMELESS = auto()
    RIVALS_COMPARED = auto()
    BOUNDS = auto()
    LAW = auto()
    SIMULATION = auto()
    NEXT_EXPERIMENT = auto()
    IDENTIFIABILITY = auto()
    ESTIMATION = auto()
    HELD_OUT = auto()
    POSSIBLE_INERTIAS = auto()
    MODEL_FILES = auto()
    POSTURES = auto()
    RANDOM_MOTIONS = auto()
    DESCENT = auto()
    MAP = auto()
    LINKS = auto()
    BATCH = auto()
    WRITING = auto()
    DRAWING = auto()


@dataclass(frozen=True)
class Announcement:
    """Progress of a run.

    Attributes:
        stage: Stage of the run.
        done: Parts of the stage that are done.
        of: Number of parts of the stage; 0 if they are not counted.
        detail: Further values, by name: a file, an estimator, a cost.
    """

    stage: Stage
    done: int = 0
    of: int = 0
    detail: Mapping[str, float | str] = field(default_factory=dict)


Progress = Callable[[Announcement], None]
"""Function that is called with each announcement of a run."""
