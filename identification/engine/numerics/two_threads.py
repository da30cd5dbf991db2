"""Applies a function to many items in two threads."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

S = TypeVar("S")
T = TypeVar("T")

# NumPy's products, filters and elementwise functions release the interpreter's lock. More than two threads would mostly
# wait for each other.
_THREADS = 2


def in_two_threads(work: Callable[[S], T], things: Iterable[S]) -> list[T]:
    """Results of ``work`` for each item, in order, computed in two threads."""
    with ThreadPoolExecutor(_THREADS) as pool:
        return list(pool.map(work, things))
