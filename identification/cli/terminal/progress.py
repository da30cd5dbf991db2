"""What is being done, for how long and how far: a line that moves on a terminal, elsewhere one every ten seconds."""

from __future__ import annotations

import threading
import time
from contextlib import ExitStack
from types import TracebackType
from typing import TYPE_CHECKING, TextIO

from identification.cli.terminal.interrupts import end_if_asked
from identification.cli.terminal.percentage import Percentage, Share
from identification.cli.terminal.stage_times import StageTimes
from identification.stages import Announcement, Stage
from identification.words.stage_words import stage_words
from phantom_dyn.errors import printable

if TYPE_CHECKING:
    from phantom_dyn._kernels.jit import Compilation

EVERY_S = 10.0
"""Time between two lines where nobody watches a terminal [s]."""
COMPILING_S = 2.0
"""Time of compiling after which a line says so there [s]: a first run compiles for up to half a minute."""
_LOOKED_S = 0.25
"""How often it is looked whether something is compiled [s]."""
_REDRAWN_HZ = 4.0
"""How often the line on a terminal is drawn anew: each time takes about a millisecond of the work."""


class Progress:
    """Context that says on ``stream`` what is being done while it is open.

    On a terminal a spinner stands before the words. Elsewhere a line is written every ten seconds, so that the log of
    a long run shows that it goes on, and one as soon as functions have been compiled for two seconds, as only a first
    run does; a run that is shorter leaves nothing. Where the stages of the run are known the part that is done stands
    before the words, and what is compiled behind them.
    """

    def __init__(
        self,
        first: Stage,
        stream: TextIO,
        *,
        stages: tuple[Share, ...] = (),
        every: float | None = None,
        times: StageTimes | None = None,
    ) -> None:
        self._stream, self._now, self._done = stream, Announcement(first), False
        self._started = time.monotonic()
        self._every = EVERY_S if every is None else every
        self._percentage = Percentage(stages) if stages else None
        self._times = times
        self._compilation: Compilation | None = None
        self._open = ExitStack()
        self._status = None
        self._ended = threading.Event()
        self._told = False

    def __enter__(self) -> Progress:
        from phantom_dyn._kernels.jit import watched_compilation

        self._compilation = self._open.enter_context(watched_compilation())
        self._enter_stage()
        if self._stream.isatty():
            self._start_line()
        else:
            threading.Thread(target=self._tell, daemon=True).start()
        return self

    def _start_line(self) -> None:
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

        console = Console(file=self._stream)
        columns = (SpinnerColumn(), Said(), TimeElapsedColumn())
        self._status = Bar(*columns, console=console, transient=True, refresh_per_second=_REDRAWN_HZ)
        try:
            self._status.start()
            self._status.add_task("", total=None)
        except BaseException:
            # __exit__ is not called then, and an interrupt would leave the cursor hidden.
            self._status.stop()
            self._open.close()
            raise

    def _tell(self) -> None:
        """Write a line every ten seconds until the end, and one when something has been compiled for two."""
        step = min(_LOOKED_S, self._every)
        waited = compiled = 0.0
        while not self._ended.wait(step):
            waited += step
            before = compiled
            compiled += step if self._compiles() else 0.0
            regular, first = waited >= self._every, before < COMPILING_S <= compiled
            if not (regular or first):
                continue
            if not self._written(self.said()):
                return
            if regular:
                waited, self._told = 0.0, True

    def _written(self, words: str) -> bool:
        """Write a line; False where whoever reads the stream is gone."""
        try:
            print(f"{time.monotonic() - self._started:.0f} s: {words}", file=self._stream, flush=True)
        except (OSError, ValueError):
            return False
        return True

    def said(self) -> str:
        """How much is done, what is being done, and what is compiled for it."""
        part = "" if self._percentage is None else f"{int(self._percentage.now()):3d} % "
        compiled = ""
        if self._compilation is not None and self._compilation.under_way:
            compiled = f"; compiling function {self._compilation.functions}, in a first run only"
        words = "done" if self._done else stage_words(self._now)
        return printable(f"{part}{words}{compiled}".strip())

    def _compiles(self) -> bool:
        return self._compilation is not None and self._compilation.under_way > 0

    def show(self, announced: Announcement) -> None:
        """Show what is being done now; a Ctrl-C that went unheard until here ends the command."""
        end_if_asked()
        self._now = announced
        self._enter_stage()

    def _enter_stage(self) -> None:
        if self._percentage is not None:
            self._percentage.enter(self._now)
        if self._times is not None:
            self._times.enter(self._now)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ended.set()
        self._open.close()
        if kind is None and self._percentage is not None:
            self._percentage.end()
            self._done = True
            if self._told:
                self._written(self.said())
        if self._status is not None:
            self._status.stop()
