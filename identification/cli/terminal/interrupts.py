"""Lets Ctrl-C and SIGTERM end a command cleanly, even if a library catches the exception."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

_ENDING = {signal.SIGINT: signal.default_int_handler, signal.SIGTERM: signal.SIG_DFL, signal.SIGHUP: signal.SIG_DFL}
"""Signals that end a command, and Python's own handling of each."""


class Interrupted(KeyboardInterrupt):
    """The user asked the command to end.

    It is a class of its own because Python remembers a plain ``KeyboardInterrupt`` in ``exec`` of a string (which makes
    every dataclass), and kills the process at its end although the exception was caught.

    Attributes:
        number: Number of the signal.
    """

    def __init__(self, number: int = signal.SIGINT):
        super().__init__()
        self.number = number


class _Handler:
    """Raises `Interrupted`, and remembers it because an import that catches every exception may swallow it."""

    def __init__(self) -> None:
        self.asked: int | None = None

    def __call__(self, number: int, _frame: FrameType | None) -> None:
        self.asked = number
        raise Interrupted(number)


@contextmanager
def interruptible() -> Iterator[None]:
    """Raise `Interrupted` for Ctrl-C, SIGTERM and a closed terminal, unless the process handles them in its own way.

    Without this, SIGTERM would leave temporary files and processes behind.
    """
    # Only the main thread may set a handler, and a signal that the process ignores stays ignored.
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    handler = _Handler()
    default_handlers = {number: default for number, default in _ENDING.items() if signal.getsignal(number) is default}
    for number in default_handlers:
        signal.signal(number, handler)
    try:
        yield
    finally:
        for number, default in default_handlers.items():
            signal.signal(number, default)


def end_if_asked() -> None:
    """Raise `Interrupted` if a signal came since `interruptible` began but its exception was swallowed."""
    for number in _ENDING:
        handler = signal.getsignal(number)
        if isinstance(handler, _Handler) and handler.asked is not None:
            raise Interrupted(handler.asked)
