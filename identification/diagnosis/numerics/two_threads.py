"""Work on many things, two at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

S = TypeVar("S")
T = TypeVar("T")

# Products, filters and elementwise functions let go of the interpreter; more threads than two wait for each other.
_THREADS = 2


def two_at_a_time(work: Callable[[S], T], things: Iterable[S]) -> list[T]:
    """What ``work`` gives for each thing, in order."""
    with ThreadPoolExecutor(_THREADS) as pool:
        return list(pool.map(work, things))
