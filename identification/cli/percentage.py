"""How far a run is in per cent, from the stages that it announces and the share of the time that each usually takes."""

from __future__ import annotations

import math
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
    Stage("simulating", 3.0),
    Stage("choosing what to record next", 5.0),
    Stage("writing", 26.0),
)
"""Stages of ``phantom-dyn diagnose``. Shares are rounded means over eight recordings of one to seven joints, which took
3 to 93 s each with their reports. On these what is shown is 3 to 19 points beside the time that has passed (root mean
square of a run), at most 33: rivals take from a twentieth to two fifths of a run."""

_ROUND = 1 / 3
"""Part of what is left of a stage that one more round of it is worth: how many there will be nobody knows."""
_LEAST_S = 0.5
"""Shortest time that a stage is expected to take [s], where what came before says nothing yet."""

_LAST = 99.0
"""The most before the end [%]."""


class Percentage:
    """Part of a run that is done [%]: never falls, is 100 at the end alone.

    Within a stage it nears the end of that stage, as fast as the run has been up to there: what takes longer than usual
    makes it slow, never wrong by more than the stage.
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
        now = self.now()
        if found == self._at:
            now = max(now, self._low + _ROUND * (self._high - self._low))
        else:
            self._at, begin = found, sum(stage.share for stage in self._stages[:found])
            now, self._high = max(now, begin), begin + self._stages[found].share
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
