"""What is being done and for how long: a line that moves on a terminal, elsewhere a new line every ten seconds."""

from __future__ import annotations

import threading
import time
from types import TracebackType
from typing import TextIO

from identification.cli.interrupts import end_if_asked

EVERY_S = 10.0
"""Time between two lines where nobody watches a terminal [s]."""


class Progress:
    """Context that says on ``stream`` what is being done while it is open.

    On a terminal a spinner stands before the words. Elsewhere a line is written every ten seconds, so that the log of
    a long run shows that it goes on; a run that is shorter leaves nothing.
    """

    def __init__(self, words: str, stream: TextIO, *, every: float | None = None):
        self._stream, self._words = stream, words
        self._started = time.monotonic()
        self._every = EVERY_S if every is None else every
        self._status = None
        self._ended = threading.Event()
        self._teller = None

    def __enter__(self) -> Progress:
        if self._stream.isatty():
            from rich.console import Console
            from rich.progress import Progress as Bar
            from rich.progress import SpinnerColumn, TextColumn, TimeElapsedColumn

            columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
            self._status = Bar(*columns, console=Console(file=self._stream), transient=True)
            try:
                self._status.start()
                self._task = self._status.add_task(self._words, total=None)
            except BaseException:
                # __exit__ is not called then, and an interrupt would leave the cursor hidden.
                self._status.stop()
                raise
        else:
            self._teller = threading.Thread(target=self._tell, daemon=True)
            self._teller.start()
        return self

    def _tell(self) -> None:
        """Write a line every ten seconds until the end; whoever reads the stream may be gone."""
        while not self._ended.wait(self._every):
            try:
                print(f"{time.monotonic() - self._started:.0f} s: {self._words}", file=self._stream, flush=True)
            except (OSError, ValueError):
                return

    def show(self, words: str) -> None:
        """Show what is being done now; a Ctrl-C that went unheard until here ends the command."""
        end_if_asked()
        self._words = words
        if self._status is not None:
            self._status.update(self._task, description=words)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ended.set()
        if self._status is not None:
            self._status.stop()
