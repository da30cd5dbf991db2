"""Compilation of functions at their first call, with machine code kept on disk; the identity without numba.

`NUMBA_DISABLE_JIT=1` counts as no numba.
"""

from __future__ import annotations

import inspect
import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from typing import Any, TypeVar, cast

F = TypeVar("F", bound=Callable[..., Any])

try:
    from numba import config, njit
    from numba.core import event as numba_events
except ImportError:  # numba has no build for this Python: the same functions, uncompiled
    njit = numba_events = None
else:
    # NUMBA_DISABLE_JIT=1: as without numba, so that loops over samples are Pinocchio's.
    if getattr(config, "DISABLE_JIT", 0):
        njit = None


def _compiled(function: F, **options: Any) -> F:
    if njit is None:
        return function
    # Nobody asks for an address that C could call; making one takes a tenth of a compilation.
    plain = inspect.unwrap(function)
    options = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True, **options}
    try:
        return cast(F, njit(cache=True, **options)(plain))
    except RuntimeError:  # neither the folder of the package nor the user's cache can be written to
        _say_that_nothing_is_kept()
        return cast(F, njit(**options)(plain))


@cache
def _say_that_nothing_is_kept() -> None:
    """Warn once a process that compiled functions cannot be kept: all of them have the same reason."""
    logging.getLogger("phantom_dyn").warning(
        "No folder for compiled loops can be written to, so every process compiles them anew (some seconds): set the "
        "environment variable NUMBA_CACHE_DIR to a folder that can."
    )


def jit(function: F) -> F:
    """A function compiled at its first call: free of the GIL, division as in NumPy, machine code kept on disk.

    Arguments are scalars, arrays and other compiled functions; a first call takes a second or so, later processes load
    what the first one wrote, where it could be written. Without numba the function itself: slower, with the same
    result. What wraps a function to check its annotations, as the tests do, is taken off: it cannot be compiled.
    """
    return _compiled(function)


def fused(function: F) -> F:
    """As `jit`, and a product may be added to a sum in one instruction: faster, the last digit may differ."""
    return _compiled(function, fastmath={"contract"})


def inlined(function: F) -> F:
    """As `fused`, for a short function that disappears into the compiled functions that call it."""
    return _part(function, fastmath={"contract"})


def within(function: F) -> F:
    """As `jit`, for a part of a larger function that disappears into it: as fast as if it were written there."""
    return _part(function)


def _part(function: F, **options: Any) -> F:
    """The function itself, which compiled functions find compiled.

    What a call from Python needs besides is not compiled, as nothing but tests calls a part.
    """
    part: Any = _compiled(function, forceinline=True, no_cpython_wrapper=True, **options)
    if njit is None:
        return function
    plain: Any = inspect.unwrap(function)
    # Numba asks any object for its type, and that of a compiled function does not keep it alive.
    plain._numba_type_, plain.compiled = part._numba_type_, part
    return plain


def compiles() -> bool:
    """False where numba is absent or off: then a loop over Pinocchio is faster than a compiled loop's own Python."""
    return njit is not None


@dataclass
class Compilation:
    """What is compiled while it is watched; what is loaded from the disk does not count.

    Attributes:
        functions: How many were begun.
        under_way: How many are not finished: more than one where a function calls others that are not compiled yet.
    """

    functions: int = 0
    under_way: int = 0


@contextmanager
def watched_compilation() -> Iterator[Compilation]:
    """A count of the functions that are compiled while the context is open; of none without numba."""
    count = Compilation()
    if numba_events is None:
        yield count
        return

    class Counting(numba_events.Listener):
        def on_start(self, event: object) -> None:
            del event
            count.functions += 1
            count.under_way += 1

        def on_end(self, event: object) -> None:
            del event
            count.under_way -= 1

    with numba_events.install_listener("numba:compile", Counting()):
        yield count
