"""Random number generators: each use in the project has its own stream of numbers, the same in every run."""

from __future__ import annotations

import zlib

import numpy as np

_PROJECT = 20260101


def random_stream(use: str) -> np.random.Generator:
    """Random number generator for one use, independent of the generators for other uses.

    Args:
        use: Name of the use, such as ``"bootstrap of rivals"``.
    """
    return np.random.default_rng(np.random.SeedSequence(_PROJECT, spawn_key=(zlib.crc32(use.encode()),)))
