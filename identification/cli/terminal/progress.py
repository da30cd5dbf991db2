"""Shows the progress of a run: one redrawn line on a terminal, otherwise a new line every ten seconds."""

from __future__ import annotations

import time
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from types import MappingProxyType, TracebackType
from typing import TYPE_CHECKING, TextIO

from identification.cli.terminal.interrupts import end_if_asked
from identification.cli.terminal.stage_times import StageTimes
from identification.stages import Announcement, Stage
from identification.words.stage_words import stage_words
from phantom_dyn._kernels.jit import Compilation, watched_compilation
from phantom_dyn.errors import printable

if TYPE_CHECKING:
    from rich.progress import Progress as Bar

EVERY_S = 10.0
"""Smallest time between two lines if the stream is not a terminal [s]; shorter runs print no line."""

# Stages of each command, and the usual share of the command's time that each stage takes [%].
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
"""``phantom-dyn diagnose`` until the summary is printed. Shares are rounded means over recordings of one to seven
joints (`python benchmarks/stage_shares.py`). For a single recording the share of the comparison with rivals may be much
smaller or larger."""
AFTER_DIAGNOSIS = {Stage.NEXT_EXPERIMENT: 17.0, Stage.WRITING: 83.0}
"""``phantom-dyn diagnose`` after the summary is printed."""
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
"""``phantom-dyn identify``. In short runs most time is for loading libraries, in long runs for estimation."""
CHECK = {Stage.READING: 40.0, Stage.CHECKING: 60.0}
"""``phantom-dyn check``, for each recording."""
EXCITATION = {
    Stage.LOADING: 20.0,
    Stage.POSTURES: 2.0,
    Stage.RANDOM_MOTIONS: 18.0,
    Stage.DESCENT: 58.0,
    Stage.WRITING: 2.0,
}
"""``phantom-dyn excite``."""
MAP = {Stage.LOADING: 15.0, Stage.MAP: 35.0, Stage.WRITING: 30.0, Stage.DRAWING: 20.0}
"""``phantom-dyn map``."""
VIEW = {Stage.LOADING: 30.0, Stage.FILTERING: 10.0, Stage.SIMULATION: 40.0, Stage.LINKS: 20.0}
"""``phantom-dyn view``."""
BATCH = {Stage.LOADING: 1.0, Stage.BATCH: 98.0, Stage.WRITING: 1.0}
"""``phantom-dyn diagnose --each``."""


def percent_done(stages: Mapping[Stage, float], now: Announcement) -> float:
    """Share of a run that is done at an announcement [%]; 0 if the run does not have the announced stage.

    Args:
        stages: Stages of the run in their order, and the share of the run's time that each takes [%].
        now: The announcement; finished parts of the announced stage count.
    """
    if now.stage not in stages:
        return 0.0
    before = sum(list(stages.values())[: list(stages).index(now.stage)])
    return before + stages[now.stage] * (min(now.done / now.of, 1.0) if now.of else 0.0)


class Progress:
    """Context that shows the current stage of a run on ``stream``.

    If the stages of the run are given, the line begins with the finished per cent. In the first run after an
    installation, functions are compiled, and the line ends with the number of compiled functions.
    """

    def __init__(
        self,
        first: Stage,
        stream: TextIO,
        *,
        stages: Mapping[Stage, float] = MappingProxyType({}),
        times: StageTimes | None = None,
    ) -> None:
        self._stream, self._stages, self._times = stream, stages, times
        self._on_terminal = stream.isatty()
        self._now, self._percent = Announcement(first), 0.0
        self._started = self._last = time.monotonic()
        self._compilation, self._open = Compilation(), ExitStack()

    def __enter__(self) -> Progress:
        # If an interrupt comes before everything is opened, the stack closes what is open. Otherwise the cursor would
        # remain hidden.
        with ExitStack() as opened:
            self._compilation = opened.enter_context(watched_compilation())
            if self._on_terminal:
                bar = self._bar()
                opened.callback(bar.stop)
                bar.start()
            self._open = opened.pop_all()
        self._take(self._now)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._open.close()

    def _bar(self) -> Bar:
        from rich.console import Console
        from rich.progress import Progress as Bar
        from rich.progress import ProgressColumn, SpinnerColumn, Task, TimeElapsedColumn
        from rich.text import Text

        current_line = self.line

        class Line(ProgressColumn):
            """The current line. Its text is computed only when it is drawn, so that announcements take no time."""

            def render(self, task: Task) -> Text:
                del task
                return Text(current_line())

        columns = (SpinnerColumn(), Line(), TimeElapsedColumn())
        # Four redraws per second, as each takes about a millisecond.
        bar = Bar(*columns, console=Console(file=self._stream), transient=True, refresh_per_second=4.0)
        bar.add_task("", total=None)
        return bar

    def line(self) -> str:
        """The line to show: finished per cent, current stage, and number of compiled functions.

        A terminal shows the function that is being compiled. On other streams lines are printed between stages, when
        no function is being compiled, so they show the number of functions compiled so far.
        """
        percent, count = f"{int(self._percent):3d} % " if self._stages else "", self._compilation.functions
        compiled = ""
        if self._compilation.under_way:
            compiled = f"; compiling function {count}, in a first run only"
        elif count and not self._on_terminal:
            compiled = f"; functions compiled so far, in a first run only: {count}"
        return printable(f"{percent}{stage_words(self._now)}{compiled}".strip())

    def show(self, announced: Announcement) -> None:
        """Show the announced stage.

        If a library has caught the exception of a Ctrl-C, the command ends here.
        """
        end_if_asked()
        self._take(announced)
        now = time.monotonic()
        if not self._on_terminal and now - self._last >= EVERY_S:
            self._last = now
            with suppress(OSError, ValueError):  # the stream may be closed
                print(f"{now - self._started:.0f} s: {self.line()}", file=self._stream, flush=True)

    def _take(self, announced: Announcement) -> None:
        self._now, self._percent = announced, max(self._percent, percent_done(self._stages, announced))
        if self._times is not None:
            self._times.enter(announced)
