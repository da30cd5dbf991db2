"""Measures the clock time and processor time of each stage of a run, for ``--profile``."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

from identification.stages import Announcement, Stage
from identification.words.stage_words import NAMES

_BEFORE = "starting and loading"
"""Name of the row for the time before the first stage, of which only the processor time is known."""


@dataclass(frozen=True)
class Mark:
    """Times at the announcement of a stage.

    Attributes:
        stage: The announced stage; None for the end of the run.
        clock: Time of a monotonic clock [s].
        processor: Processor time that all threads of this process have used so far [s].
    """

    stage: Stage | None
    clock: float
    processor: float


class StageTimes:
    """Records the times at which the stages of a run are announced.

    Args:
        now: Function that returns clock time and processor time [s].
    """

    def __init__(
        self,
        now: Callable[[], tuple[float, float]] = lambda: (time.perf_counter(), time.process_time()),
    ):
        self._now = now
        self._marks: list[Mark] = []

    def enter(self, announced: Announcement) -> None:
        """Record an announcement."""
        self._marks.append(Mark(announced.stage, *self._now()))

    def rows(self) -> dict[str, tuple[float, float]]:
        """Clock and processor time of each stage so far [s], in the order of first announcement."""
        out: dict[str, tuple[float, float]] = {}
        for mark, following in pairwise([*self._marks, Mark(None, *self._now())]):
            assert mark.stage is not None
            name = NAMES[mark.stage]
            clock, processor = out.get(name, (0.0, 0.0))
            out[name] = clock + following.clock - mark.clock, processor + following.processor - mark.processor
        return out

    def table(self) -> str:
        """Table with the time before the first stage, a row for each stage, the sums, and the peak memory."""
        rows, before = self.rows(), self._marks[0].processor if self._marks else 0.0
        width = max(len(_BEFORE), *map(len, rows)) if rows else len(_BEFORE)
        lines = [f"{'stage':<{width}}  seconds  of processor time", f"{_BEFORE:<{width}}           {before:17.2f}"]
        lines += [f"{name:<{width}}  {clock:7.2f}  {processor:17.2f}" for name, (clock, processor) in rows.items()]
        clock, processor = (sum(row[k] for row in rows.values()) for k in (0, 1))
        lines.append(f"{'all':<{width}}  {clock:7.2f}  {before + processor:17.2f}")
        peak = peak_megabytes()
        return "\n".join([*lines, f"most memory: {peak:.0f} MB"] if peak is not None else lines)


def peak_megabytes() -> float | None:
    """Peak memory of this process [MB]; None if the system does not report it."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    size = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return size / (2**20 if sys.platform == "darwin" else 2**10)
