"""Compilation of functions at their first call, with machine code kept on disk.

Numba is loaded by the first call of a compiled function and not before: that takes as long as a small command does.
With `NUMBA_DISABLE_JIT=1` all functions are plain Python, for a debugger: the same results, far slower.
"""

from __future__ import annotations

import functools
import inspect
import logging
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from threading import RLock
from typing import Any, TypeVar, cast

F = TypeVar("F", bound=Callable[..., Any])

_one_at_a_time = RLock()


@cache
def njit() -> Callable[..., Any]:
    """Numba's decorator, for which numba is loaded."""
    from numba import njit as decorator
    from numba.core import event

    event.register("numba:compile", _counting(event.Listener))
    return decorator


class Compiled:
    """A function that numba compiles at its first call.

    Numba asks any object for its type: compiled functions call this one as they call each other.

    Attributes:
        py_func: The plain function. What wraps it to check its annotations, as the tests do, is taken off: it cannot be
            compiled.
    """

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        functools.update_wrapper(self, function)
        self.py_func = inspect.unwrap(function)
        self._options, self._made = options, None

    def __call__(self, *args: Any) -> Any:
        return (self._made or self.compiled)(*args)

    def __reduce__(self) -> Any:
        """By its name where it has one, as functions are: what is pickled or copied is the same function there."""
        module = sys.modules.get(self.py_func.__module__)
        for name, value in vars(module).items() if module else ():
            if value is self:
                return name
        return type(self), (self.py_func, self._options)

    @property
    def compiled(self) -> Any:
        """Numba's function."""
        with _one_at_a_time:
            if self._made is None:
                self._made = _decorated(njit(), self.py_func, self._options)
        return self._made

    @property
    def signatures(self) -> list[Any]:
        """Of what is compiled so far."""
        return self.compiled.signatures

    @property
    def targetoptions(self) -> dict[str, Any]:
        """What numba was asked for."""
        return self.compiled.targetoptions

    @property
    def _numba_type_(self) -> Any:
        return self.compiled._numba_type_


class Part(Compiled):
    """A function that disappears into the compiled functions that call it, and stays Python when Python calls it.

    What a call from Python needs besides is not compiled, as nothing but tests and plain functions calls a part.
    """

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        super().__init__(function, {"forceinline": True, "no_cpython_wrapper": True, **options})

    def __call__(self, *args: Any) -> Any:
        return self.py_func(*args)


def _decorated(decorator: Callable[..., Any], plain: Callable[..., Any], options: dict[str, Any]) -> Any:
    # Nobody asks for an address that C could call; making one takes a tenth of a compilation.
    options = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True, **options}
    try:
        return _loading_little(decorator(cache=True, **options)(plain))
    except RuntimeError:  # neither the folder of the package nor the user's cache can be written to
        _say_that_nothing_is_kept()
        return decorator(**options)(plain)


def _loading_little(made: Any) -> Any:
    """Numba's function, which loads what is kept of it without all that numba can compile.

    All of it takes a tenth of the time of a small command. Where something is compiled after all, numba loads it then.
    """
    try:
        from numba.core.runtime.nrt import rtsys

        kept = made._cache
        load, undisturbed = kept._load_overload, kept._guard_against_spurious_io_errors
    except (ImportError, AttributeError):  # another numba: it loads all
        return made

    def load_overload(signature: Any, target: Any) -> Any:
        rtsys.initialize(target)  # memory of arrays: all that compiled functions need at hand
        with undisturbed():
            return load(signature, target)
        return None

    kept.load_overload = load_overload
    return made


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
    what the first one wrote, where it could be written.
    """
    return cast(F, Compiled(function, {}))


def fused(function: F) -> F:
    """As `jit`, and a product may be added to a sum in one instruction: faster, the last digit may differ."""
    return cast(F, Compiled(function, {"fastmath": {"contract"}}))


def inlined(function: F) -> F:
    """As `fused`, for a short function that disappears into the compiled functions that call it."""
    return cast(F, Part(function, {"fastmath": {"contract"}}))


def within(function: F) -> F:
    """As `jit`, for a part of a larger function that disappears into it: as fast as if it were written there."""
    return cast(F, Part(function, {}))


@dataclass
class Compilation:
    """What is compiled while it is watched; what is loaded from the disk does not count.

    Attributes:
        functions: How many were begun.
        under_way: How many are not finished: more than one where a function calls others that are not compiled yet.
    """

    functions: int = 0
    under_way: int = 0


_watching: list[Compilation] = []


@contextmanager
def watched_compilation() -> Iterator[Compilation]:
    """A count of the functions that are compiled while the context is open."""
    if "numba" in sys.modules:
        njit()
    count = Compilation()
    _watching.append(count)
    try:
        yield count
    finally:
        # By identity: counts that are open together may be equal.
        _watching[:] = [other for other in _watching if other is not count]


def _counting(listener: type) -> Any:
    """Numba's listener that counts for all that watch."""

    class Counting(listener):
        def on_start(self, event: object) -> None:
            del event
            for count in _watching:
                count.functions += 1
                count.under_way += 1

        def on_end(self, event: object) -> None:
            del event
            for count in _watching:
                count.under_way -= 1

    return Counting()
