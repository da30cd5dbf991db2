"""Decorators that compile functions with numba at their first call and store the machine code on disk.

Numba is imported at the first of these calls and not before, because the import takes as long as a small command.
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

_compile_lock = RLock()


@cache
def njit() -> Callable[..., Any]:
    """Numba's decorator `njit`."""
    from numba import njit as decorator
    from numba.core import event

    event.register("numba:compile", _counting_listener(event.Listener))
    return decorator


class Compiled:
    """A function that numba compiles at its first call.

    Other compiled functions can call it: numba reads the type of an object from its `_numba_type_`.

    Attributes:
        py_func: The plain Python function, without decorators that check its annotations, which numba cannot compile.
    """

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        functools.update_wrapper(self, function)
        self.py_func = inspect.unwrap(function)
        self._options, self._dispatcher = options, None

    def __call__(self, *args: Any) -> Any:
        return (self._dispatcher or self.compiled)(*args)

    def __reduce__(self) -> Any:
        """Pickle by name if the function is a global of its module, as Python does with plain functions."""
        module = sys.modules.get(self.py_func.__module__)
        for name, value in vars(module).items() if module else ():
            if value is self:
                return name
        return type(self), (self.py_func, self._options)

    @property
    def compiled(self) -> Any:
        """Numba's dispatcher of this function, made at the first use."""
        with _compile_lock:
            if self._dispatcher is None:
                self._dispatcher = _decorated(njit(), self.py_func, self._options)
        return self._dispatcher

    @property
    def signatures(self) -> list[Any]:
        """Signatures that are compiled so far."""
        return self.compiled.signatures

    @property
    def _numba_type_(self) -> Any:
        return self.compiled._numba_type_


class Inlined(Compiled):
    """A function that is inlined into the compiled functions that call it, and runs as plain Python if Python calls it.

    No wrapper for calls from Python is compiled, because only tests and plain functions make such calls.
    """

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        super().__init__(function, {"forceinline": True, "no_cpython_wrapper": True, **options})

    def __call__(self, *args: Any) -> Any:
        return self.py_func(*args)


def _decorated(decorator: Callable[..., Any], function: Callable[..., Any], options: dict[str, Any]) -> Any:
    """Numba's dispatcher of a function, with machine code stored on disk if a folder for it can be written to."""
    # C never calls these functions, and a wrapper for C takes a tenth of a compilation.
    options = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True, **options}
    try:
        return _with_fast_loading(decorator(cache=True, **options)(function))
    except RuntimeError:  # neither the folder of the package nor the user's cache can be written to
        _warn_without_cache()
        return decorator(**options)(function)


def _with_fast_loading(dispatcher: Any) -> Any:
    """The dispatcher, changed to load cached machine code without numba's registries of all that it can compile.

    Loading the registries takes a tenth of the time of a small command. Numba loads them later if a function has to be
    compiled after all. The second change is that cached code counts as missing if it refers to a type that a newer
    version of this package has renamed: numba would fail to read it before it notices that the source has changed.
    """
    try:
        from numba.core.runtime.nrt import rtsys

        cached = dispatcher._cache
        load, guarded = cached._load_overload, cached._guard_against_spurious_io_errors
        index, read_index = cached._cache_file, cached._cache_file._load_index
    except (ImportError, AttributeError):  # a version of numba with other internals: it loads the registries
        return dispatcher

    def load_overload(signature: Any, target: Any) -> Any:
        rtsys.initialize(target)  # allocation of arrays, the only part of the runtime that compiled functions use
        with guarded():
            return load(signature, target)
        return None

    def known_overloads() -> dict[Any, str]:
        try:
            return read_index()
        except (AttributeError, ImportError):  # a type that was renamed or moved
            return {}

    cached.load_overload, index._load_index = load_overload, known_overloads
    return dispatcher


@cache
def _warn_without_cache() -> None:
    """Warn that compiled functions cannot be cached; once per process, because all of them have the same reason."""
    logging.getLogger("phantom_dyn").warning(
        "No folder for compiled loops can be written to, so every process compiles them anew (some seconds): set the "
        "environment variable NUMBA_CACHE_DIR to a folder that can."
    )


def jit(function: F) -> F:
    """A function compiled at its first call: without the GIL, division as in NumPy, machine code stored on disk.

    Arguments are scalars, arrays and other compiled functions. A first call takes about a second. Later processes load
    the machine code from the disk.
    """
    return cast(F, Compiled(function, {}))


def fused(function: F) -> F:
    """A function compiled as by `jit`, but faster: one instruction may multiply and add, which changes last digits."""
    return cast(F, Compiled(function, {"fastmath": {"contract"}}))


def inlined(function: F) -> F:
    """A function compiled as by `fused` and inlined into the compiled functions that call it; for short functions."""
    return cast(F, Inlined(function, {"fastmath": {"contract"}}))


def inlined_jit(function: F) -> F:
    """A function compiled as by `jit` and inlined into the compiled functions that call it; for parts of long ones."""
    return cast(F, Inlined(function, {}))


@dataclass
class Compilation:
    """Count of compilations; functions that are loaded from the disk do not count.

    Attributes:
        functions: Number of compilations that have begun.
        under_way: Number of compilations that have begun and are not finished. It is larger than one while a function
            is compiled that calls others that are not compiled yet.
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
        # Compared by identity, because several open counts may be equal.
        _watching[:] = [other for other in _watching if other is not count]


def _counting_listener(listener: type) -> Any:
    """Listener of numba's events that updates the counts of all open `watched_compilation` contexts."""

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
