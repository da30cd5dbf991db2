"""The same work for each joint's torque, two rows at a time."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

T = TypeVar("T")

# Products, filters and elementwise functions let go of the interpreter; more threads than two wait for each other.
_THREADS = 2


def each_row(work: Callable[[int], T], count: int) -> list[T]:
    """What ``work`` gives for rows ``0 .. count - 1``, in order."""
    with ThreadPoolExecutor(_THREADS) as pool:
        return list(pool.map(work, range(count)))
