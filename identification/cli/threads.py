"""How many threads linear algebra takes."""

from __future__ import annotations

import os


def one_blas_thread() -> None:
    """Before NumPy is loaded: matrices are small, and two threads on a busy machine wait for each other."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
