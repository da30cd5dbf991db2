"""How far a run is in per cent, from the stages that it announces and the share of the time that each usually takes."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

from identification.stages import Announcement, Stage


@dataclass(frozen=True)
class Share:
    """Part of a run.

    Attributes:
        stage: Its first announcement starts it.
        percent: Of the whole time [%].
    """

    stage: Stage
    percent: float


DIAGNOSIS = (
    Share(Stage.READING, 16.0),
    Share(Stage.FILTERING, 1.0),
    Share(Stage.REGRESSORS, 12.0),
    Share(Stage.NOISE, 20.0),
    Share(Stage.CHANCE, 24.0),
    Share(Stage.RIVALS_COMPARED, 20.0),
    Share(Stage.BOUNDS, 1.0),
    Share(Stage.LAW, 2.0),
    Share(Stage.SIMULATION, 4.0),
)
"""Stages of ``phantom-dyn diagnose`` until its answer is known. Shares are rounded means over recordings of one to
seven joints; on any one of them what is shown may be many points beside the time that has passed, as rivals take a
small part or a large one (`python benchmarks/stage_shares.py` measures both)."""

AFTER_DIAGNOSIS = (
    Share(Stage.NEXT_EXPERIMENT, 17.0),
    Share(Stage.WRITING, 83.0),
)
"""What follows its answer."""

IDENTIFICATION = (
    Share(Stage.READING, 25.0),
    Share(Stage.FILTERING, 5.0),
    Share(Stage.IDENTIFIABILITY, 8.0),
    Share(Stage.ESTIMATION, 10.0),
    Share(Stage.HELD_OUT, 4.0),
    Share(Stage.POSSIBLE_INERTIAS, 8.0),
    Share(Stage.MODEL_FILES, 10.0),
    Share(Stage.WRITING, 30.0),
)
"""Stages of ``phantom-dyn identify``. A short run takes most of its time to load libraries, a long one to estimate; so
of the next two."""

CHECK = (Share(Stage.READING, 40.0), Share(Stage.CHECKING, 60.0))
"""Stages of ``phantom-dyn check``, for each recording."""

EXCITATION = (
    Share(Stage.LOADING, 20.0),
    Share(Stage.POSTURES, 2.0),
    Share(Stage.RANDOM_MOTIONS, 18.0),
    Share(Stage.DESCENT, 58.0),
    Share(Stage.WRITING, 2.0),
)
"""Stages of ``phantom-dyn excite``."""

MAP = (Share(Stage.LOADING, 15.0), Share(Stage.MAP, 35.0), Share(Stage.WRITING, 30.0), Share(Stage.DRAWING, 20.0))
"""Stages of ``phantom-dyn map``."""

VIEW = (
    Share(Stage.LOADING, 30.0),
    Share(Stage.FILTERING, 10.0),
    Share(Stage.SIMULATION, 40.0),
    Share(Stage.LINKS, 20.0),
)
"""Stages of ``phantom-dyn view``."""

BATCH = (Share(Stage.LOADING, 1.0), Share(Stage.BATCH, 98.0), Share(Stage.WRITING, 1.0))
"""Stages of ``phantom-dyn diagnose`` with a table of recordings."""

_ROUND = 1 / 3
"""Part of what is left of a stage that one more round of it is worth: how many there will be nobody knows."""
_LEAST_S = 0.5
"""Shortest time that a stage is expected to take [s], where what came before says nothing yet."""

_LAST = 99.0
"""The most before the end [%]."""


class Percentage:
    """Part of a run that is done [%]: never falls, is 100 at the end alone.

    Where an announcement counts, 20 of 80 points of a map, that is the part of its stage that is done.
    Within a stage it nears the end of that stage, as fast as the run has been up to there: what takes longer than
    usual makes it slow, never wrong by more than the stage.
    """

    def __init__(self, stages: tuple[Share, ...], clock: Callable[[], float] = time.monotonic):
        self._stages, self._clock = stages, clock
        self._at = -1
        self._low = self._high = 0.0
        self._started = self._since = clock()
        self._expected = _LEAST_S
        self._ended = False

    def enter(self, announced: Announcement) -> None:
        """Take note of an announcement; one of an earlier stage, or of none, changes nothing."""
        found = next((k for k, share in enumerate(self._stages) if share.stage is announced.stage), -1)
        if found < max(self._at, 0):
            return
        now = self.now()
        if found == self._at and not announced.of:
            now = max(now, self._low + _ROUND * (self._high - self._low))
        else:
            self._at, begin = found, sum(share.percent for share in self._stages[:found])
            done, parts = announced.done, max(announced.of, 1)
            share = self._stages[found].percent / parts
            now = max(now, begin + min(done, parts) * share)
            # What is counted is not guessed beyond the part that is being done.
            self._high = max(now, begin + min(done + 1, parts) * share)
        elapsed = self._clock() - self._started
        self._low, self._since = now, self._clock()
        self._expected = max(_LEAST_S, elapsed * (self._high - now) / now if now > 0 else 0.0)

    def end(self) -> None:
        """Take note that all is done."""
        self._ended = True

    def now(self) -> float:
        """What is done [%]."""
        if self._ended:
            return 100.0
        waited = (self._clock() - self._since) / self._expected
        return min(self._low + (self._high - self._low) * (1.0 - math.exp(-waited)), _LAST)
