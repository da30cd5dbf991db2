"""Work that is done in a second process while this one goes on, where a core is free for it."""

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


def begun(work: Callable[[], T]) -> Callable[[], T]:
    """Begin some work, and return what waits for its result.

    The second process is a copy of this one (``fork``), so that nothing is loaded or handed over again. Where that is
    not possible, where no second core is free, or where the copy fails, the work is done here when its result is asked
    for: an error is raised here then.

    Args:
        work: Function to call. It has to be possible to pickle its result.
    """
    if not _has_free_core():
        return cache(work)
    context = multiprocessing.get_context("fork")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_send, args=(work, sender), daemon=True)
    with warnings.catch_warnings():
        # Threads of numerical libraries wait for work, and no other thread runs here.
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
    """Send the result in a list, which stays empty where the work could not be done."""
    result = []
    # Whatever is wrong is raised in the first process, where the work is done again.
    with suppress(Exception):
        result = [work()]
    sender.send(result)
    sender.close()


def _has_free_core() -> bool:
    """True on Linux with two cores for this process, as elsewhere a copied process may not use what it holds."""
    return sys.platform == "linux" and len(os.sched_getaffinity(0)) > 1 and not multiprocessing.current_process().daemon
