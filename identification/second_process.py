"""Run a function in a second process while this one continues, if a core is free."""

from __future__ import annotations

import multiprocessing
import os
import sys
import warnings
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from multiprocessing.connection import Connection
from typing import TypeVar

T = TypeVar("T")


def started(work: Callable[[], T]) -> Callable[[], T]:
    """Start a function in a second process; the returned function waits for its result.

    The second process is a copy of this one (``fork``), so that no module has to be loaded and no argument sent. If
    there is no free core, or if the function fails in the copy, the returned function runs it in this process and
    raises its errors.

    Args:
        work: Function to call. Its result is pickled.
    """
    if not _has_free_core():
        return cache(work)
    context = multiprocessing.get_context("fork")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_send, args=(work, sender), daemon=True)
    with warnings.catch_warnings():
        # Python warns of a fork while other threads exist. Here these are idle threads of numerical libraries.
        warnings.simplefilter("ignore", DeprecationWarning)
        process.start()
    sender.close()

    def result() -> T:
        try:
            sent: list[T] = receiver.recv()
        except (EOFError, OSError):  # the copy was killed
            sent = []
        process.join()
        return sent[0] if sent else work()

    return cache(result)


def _send(work: Callable[[], object], sender: Connection) -> None:
    """Call a function in the second process and send a list with its result, or an empty list after an error."""
    result = []
    # After an error the first process calls the function again, so that the error is raised there.
    with suppress(Exception):
        result = [work()]
    sender.send(result)
    sender.close()


def _has_free_core() -> bool:
    """True on Linux if this process may use two cores; on other systems a forked process is not safe."""
    return sys.platform == "linux" and len(os.sched_getaffinity(0)) > 1 and not multiprocessing.current_process().daemon
