"""A line on the terminal that says what is being done and for how long; silent where nobody watches."""

from __future__ import annotations

import time
from types import TracebackType
from typing import TextIO

from identification.cli.interrupts import end_if_asked


class Progress:
    """Context that shows a spinner with words on ``stream`` while it is open, if that is a terminal."""

    def __init__(self, words: str, stream: TextIO):
        self._stream, self._words = stream, words
        self._started = time.monotonic()
        self._status = None

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
        return self

    def show(self, words: str) -> None:
        """Show what is being done now; a Ctrl-C that went unheard until here ends the command."""
        end_if_asked()
        if self._status is not None:
            self._status.update(self._task, description=words)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._status is not None:
            self._status.stop()
