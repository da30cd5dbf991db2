"""Ends a command cleanly after Ctrl-C or SIGTERM, even if a library catches the exception."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

_ENDING = {signal.SIGINT: signal.default_int_handler, signal.SIGTERM: signal.SIG_DFL, signal.SIGHUP: signal.SIG_DFL}
"""Signals that end a command, and Python's default handler of each."""


class Interrupted(KeyboardInterrupt):
    """Exception for a signal that asks the command to end.

    A plain ``KeyboardInterrupt`` would not do: if it occurs in ``exec`` of a string, which defines every dataclass,
    Python remembers the exception and kills the process at its end, although the exception was caught.

    Attributes:
        number: Number of the signal.
    """

    def __init__(self, number: int = signal.SIGINT):
        super().__init__()
        self.number = number


class _Handler:
    """Signal handler that raises `Interrupted`.

    It remembers the signal, because an import that catches every exception may discard `Interrupted`.
    """

    def __init__(self) -> None:
        self.asked: int | None = None

    def __call__(self, number: int, _frame: FrameType | None) -> None:
        self.asked = number
        raise Interrupted(number)


@contextmanager
def interruptible() -> Iterator[None]:
    """Context in which Ctrl-C, SIGTERM and a closed terminal raise `Interrupted`.

    Signals for which the process has its own handler keep it. Without this context, SIGTERM would leave temporary files
    and processes.
    """
    # Only the main thread may set a handler. Signals that are ignored remain ignored.
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
    """Raise `Interrupted` if a signal has arrived since `interruptible` began, but its exception was caught."""
    for number in _ENDING:
        handler = signal.getsignal(number)
        if isinstance(handler, _Handler) and handler.asked is not None:
            raise Interrupted(handler.asked)
