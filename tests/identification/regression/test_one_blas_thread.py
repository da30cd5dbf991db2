"""One thread in the linear algebra: threadpoolctl's own list of what runs threads is the oracle."""

from __future__ import annotations

import os
import subprocess
import sys

CODE = """
import numpy
from identification.regression.triangular import one_blas_thread
from threadpoolctl import threadpool_info

with one_blas_thread():
    import scipy.linalg
    print([one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"])
"""


def test_a_linear_algebra_that_is_loaded_late_has_one_thread_too():
    threads = {name: "2" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")}
    done = subprocess.run(
        [sys.executable, "-c", CODE], env={**os.environ, **threads}, capture_output=True, text=True, check=True
    )
    counts = done.stdout.strip()
    assert set(counts.strip("[]").split(", ")) == {"1"}
