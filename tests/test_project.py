from __future__ import annotations

import os

import numpy as np


def test_linear_algebra_runs_on_one_thread_in_tests():
    assert os.environ["OMP_NUM_THREADS"] == os.environ["OPENBLAS_NUM_THREADS"] == "1"


def test_rng_gives_the_same_numbers_in_every_run(rng):
    # Known truth: the seed is the checksum of the test's name, which does not change.
    import zlib

    name = "tests/test_project.py::test_rng_gives_the_same_numbers_in_every_run"
    assert rng.random() == np.random.default_rng(zlib.crc32(name.encode())).random()
