"""``jit``: compiles a function at its first call and keeps the machine code on disk; the identity without numba."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any, TypeVar, cast

F = TypeVar("F", bound=Callable[..., Any])

try:
    from numba import njit
except ImportError:  # numba has no build for this Python: the same functions, uncompiled
    njit = None


def _compiled(function: F, **options: Any) -> F:
    if njit is None:
        return function
    plain, options = inspect.unwrap(function), {"nogil": True, "error_model": "numpy", **options}
    try:
        return cast(F, njit(cache=True, **options)(plain))
    except RuntimeError:  # neither the folder of the package nor the user's cache can be written to
        return cast(F, njit(**options)(plain))


def jit(function: F) -> F:
    """The compiled function: free of the GIL, division as in NumPy, machine code kept on disk.

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
    return _compiled(function, fastmath={"contract"}, forceinline=True)


def compiles() -> bool:
    """False where numba is absent: then a loop over Pinocchio is faster than a compiled loop's own Python."""
    return njit is not None
