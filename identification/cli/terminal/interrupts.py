"""Ctrl-C ends a command once, cleanly, even where a library catches the exception that Python raises for it."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


class Interrupted(KeyboardInterrupt):
    """The user asked the command to end.

    A class of its own, because Python remembers a plain ``KeyboardInterrupt`` that passes through ``exec`` of a
    string (every dataclass is made so) and kills the process at its end, although the exception was caught.
    """


class _Handler:
    """Raises `Interrupted` and remembers it: an import that catches everything may swallow the exception."""

    def __init__(self) -> None:
        self.asked = False

    def __call__(self, _number: int, _frame: FrameType | None) -> None:
        self.asked = True
        raise Interrupted


@contextmanager
def interruptible() -> Iterator[None]:
    """Raise `Interrupted` for Ctrl-C within the context, where the process has Python's own handling of it."""
    usual = signal.getsignal(signal.SIGINT)
    # Only the main thread may set a handler; a process that ignores Ctrl-C goes on ignoring it.
    if threading.current_thread() is not threading.main_thread() or usual is not signal.default_int_handler:
        yield
        return
    signal.signal(signal.SIGINT, _Handler())
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, usual)


def end_if_asked() -> None:
    """Raise `Interrupted` if Ctrl-C was pressed since `interruptible` began and the exception was swallowed."""
    handler = signal.getsignal(signal.SIGINT)
    if isinstance(handler, _Handler) and handler.asked:
        raise Interrupted
