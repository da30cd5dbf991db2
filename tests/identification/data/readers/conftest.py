"""Logs in every format, written by the formats' own libraries."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

N = 60


@pytest.fixture
def columns() -> dict[str, np.ndarray]:
    """A good log of two joints."""
    t = np.arange(N) * 0.01
    out = {"t": t}
    for k, joint in enumerate(("a", "b")):
        out[f"q.{joint}"] = np.sin(3 * t + k)
        out[f"v.{joint}"] = 3 * np.cos(3 * t + k)
        out[f"tau.{joint}"] = 0.1 + np.cos(5 * t + k)
    return out


@pytest.fixture
def write(tmp_path: Path) -> Callable[..., Path]:
    """Writes a text file from lines, or from columns with a separator."""

    def write_lines(lines: list[str], name: str = "log.csv", end: str = "\n", encoding: str = "utf-8") -> Path:
        path = tmp_path / name
        path.write_bytes((end.join(lines) + end).encode(encoding))
        return path

    return write_lines


@pytest.fixture
def lines(columns) -> list[str]:
    """The good log as lines of CSV."""
    rows = np.column_stack(list(columns.values()))
    return [",".join(columns), *(",".join(repr(float(x)) for x in row) for row in rows)]
