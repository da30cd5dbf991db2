"""How far a run is in per cent, from the stages that it announces and the share of the time that each usually takes."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Stage:
    """Part of a run.

    Attributes:
        words: What its announcements begin with; the first one starts it.
        share: Of the whole time [%].
    """

    words: str
    share: float


DIAGNOSIS = (
    Stage("reading", 11.0),
    Stage("filtering", 1.0),
    Stage("computing regressors", 8.0),
    Stage("estimating the noise", 14.0),
    Stage("measuring what chance gives", 17.0),
    Stage("comparing rivals", 14.0),
    Stage("stating what would have been seen", 1.0),
    Stage("looking for a law of what is left", 1.0),
    Stage("simulating", 3.0),
    Stage("choosing what to record next", 5.0),
    Stage("writing", 25.0),
)
"""Stages of ``phantom-dyn diagnose``. Shares are rounded means over recordings of one to seven joints; on any one
of them what is shown may be many points beside the time that has passed, as rivals take a small part or a large one
(`python benchmarks/stage_shares.py` measures both)."""

IDENTIFICATION = (
    Stage("reading", 25.0),
    Stage("filtering", 5.0),
    Stage("looking for what cannot be identified", 8.0),
    Stage("estimating", 10.0),
    Stage("predicting held-out samples", 4.0),
    Stage("choosing possible inertias", 8.0),
    Stage("writing and loading models", 10.0),
    Stage("writing", 30.0),
)
"""Stages of ``phantom-dyn identify``. A short run takes most of its time to load libraries, a long one to estimate; so
of the next two."""

EXCITATION = (
    Stage("loading", 20.0),
    Stage("looking for postures", 2.0),
    Stage("trying random motions", 18.0),
    Stage("round", 58.0),
    Stage("writing", 2.0),
)
"""Stages of ``phantom-dyn excite``."""

MAP = (Stage("loading", 15.0), Stage("mapping", 35.0), Stage("writing", 30.0), Stage("drawing", 20.0))
"""Stages of ``phantom-dyn map``."""

VIEW = (Stage("loading", 30.0), Stage("filtering", 10.0), Stage("simulating", 40.0), Stage("placing links", 20.0))
"""Stages of ``phantom-dyn view``."""

BATCH = (Stage("loading", 1.0), Stage("diagnos", 98.0), Stage("writing", 1.0))
"""Stages of ``phantom-dyn diagnose`` with a table of recordings."""

_COUNTED = re.compile(r"(\d+) of (\d+)")
"""In an announcement: how many parts of a stage are done, of how many."""
_ROUND = 1 / 3
"""Part of what is left of a stage that one more round of it is worth: how many there will be nobody knows."""
_LEAST_S = 0.5
"""Shortest time that a stage is expected to take [s], where what came before says nothing yet."""

_LAST = 99.0
"""The most before the end [%]."""


class Percentage:
    """Part of a run that is done [%]: never falls, is 100 at the end alone.

    Where an announcement counts, as in ``mapping 20 of 80 points``, that is the part of its stage that is done.
    Within a stage it nears the end of that stage, as fast as the run has been up to there: what takes longer than
    usual makes it slow, never wrong by more than the stage.
    """

    def __init__(self, stages: tuple[Stage, ...], clock: Callable[[], float] = time.monotonic):
        self._stages, self._clock = stages, clock
        self._at = -1
        self._low = self._high = 0.0
        self._started = self._since = clock()
        self._expected = _LEAST_S
        self._ended = False

    def enter(self, words: str) -> None:
        """Take note of an announcement; one of an earlier stage, or of none, changes nothing."""
        found = next((k for k, stage in enumerate(self._stages) if words.startswith(stage.words)), -1)
        if found < max(self._at, 0):
            return
        now, counted = self.now(), _COUNTED.search(words)
        if found == self._at and not counted:
            now = max(now, self._low + _ROUND * (self._high - self._low))
        else:
            self._at, begin = found, sum(stage.share for stage in self._stages[:found])
            done, parts = map(int, counted.groups()) if counted else (0, 1)
            share = self._stages[found].share / max(parts, 1)
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
