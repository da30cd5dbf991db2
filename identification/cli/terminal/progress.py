"""What is being done and how far it is: a line that is drawn again on a terminal, elsewhere one in ten seconds."""

from __future__ import annotations

import time
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from types import MappingProxyType, TracebackType
from typing import TYPE_CHECKING, TextIO

from identification.cli.terminal.interrupts import end_if_asked
from identification.cli.terminal.percentage import percent_done
from identification.cli.terminal.stage_times import StageTimes
from identification.stages import Announcement, Stage
from identification.words.stage_words import stage_words
from phantom_dyn._kernels.jit import Compilation, watched_compilation
from phantom_dyn.errors import printable

if TYPE_CHECKING:
    from rich.progress import Progress as Bar

EVERY_S = 10.0
"""Least time between two lines where nobody watches a terminal [s]: a shorter run leaves none."""


class Progress:
    """Context that says on ``stream`` what is being done while it is open.

    Where the stages of the run are known, the line begins with the per cent that are done. In a first run, which
    compiles functions, it ends with how many.
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
        self._watched = stream.isatty()
        self._now, self._percent = Announcement(first), 0.0
        self._started = self._last = time.monotonic()
        self._compilation, self._open = Compilation(), ExitStack()

    def __enter__(self) -> Progress:
        # Closed again where an interrupt comes before all is open: it would leave the cursor hidden.
        with ExitStack() as opened:
            self._compilation = opened.enter_context(watched_compilation())
            if self._watched:
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

        said = self.said

        class Said(ProgressColumn):
            """The words of the moment: asked for when the line is drawn, so that announcing costs nothing."""

            def render(self, task: Task) -> Text:
                del task
                return Text(said())

        columns = (SpinnerColumn(), Said(), TimeElapsedColumn())
        # Each drawing takes about a millisecond of the work.
        bar = Bar(*columns, console=Console(file=self._stream), transient=True, refresh_per_second=4.0)
        bar.add_task("", total=None)
        return bar

    def said(self) -> str:
        """How much is done, what is being done, and what is compiled for it.

        A terminal is drawn while a function is compiled; other streams get a line between two stages, when none is.
        """
        part, count = f"{int(self._percent):3d} % " if self._stages else "", self._compilation.functions
        behind = ""
        if self._compilation.under_way:
            behind = f"; compiling function {count}, in a first run only"
        elif count and not self._watched:
            behind = f"; functions compiled so far, in a first run only: {count}"
        return printable(f"{part}{stage_words(self._now)}{behind}".strip())

    def show(self, announced: Announcement) -> None:
        """Show what is being done now; a Ctrl-C that went unheard until here ends the command."""
        end_if_asked()
        self._take(announced)
        now = time.monotonic()
        if not self._watched and now - self._last >= EVERY_S:
            self._last = now
            with suppress(OSError, ValueError):  # whoever reads the stream is gone
                print(f"{now - self._started:.0f} s: {self.said()}", file=self._stream, flush=True)

    def _take(self, announced: Announcement) -> None:
        self._now, self._percent = announced, max(self._percent, percent_done(self._stages, announced))
        if self._times is not None:
            self._times.enter(announced)
