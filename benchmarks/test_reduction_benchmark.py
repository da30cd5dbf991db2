"""Time the reduction of 100000 rows and 70 columns, as for a six-joint arm, with block-wise TSQR and a full QR."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from identification.estimators.fit import refit
from identification.regression.reduction import Reduction, reduce_blocks

JOINTS, SAMPLES = 5, 20_000
"""Five rows for each sample: 100000 rows."""

EDGES = (0, 14, 28, 42, 56, 70)
"""First columns of the bodies: a joint depends on its own body and later ones."""

BASE, BLOCK = 8, 1400
"""Independent columns of the 14 of a body, about as for rigid bodies with friction; rows of a block of the TSQR."""

OWN = tuple(tuple(range(first, EDGES[-1])) for first in EDGES[:-1])


@pytest.fixture(scope="module")
def rows() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    W = np.zeros((SAMPLES, JOINTS, EDGES[-1]))
    for first, last in pairwise(EDGES):
        mixed = np.hstack([np.eye(BASE), rng.normal(size=(BASE, last - first - BASE))])
        joints = EDGES.index(first) + 1
        W[:, :joints, first:last] = rng.normal(size=(SAMPLES, joints, BASE)) @ mixed
    return W, rng.normal(size=(SAMPLES, JOINTS))


def reduced(W: np.ndarray, y: np.ndarray) -> Reduction:
    names = tuple(f"c{k}" for k in range(W.shape[2]))
    joints = tuple(f"j{k}" for k in range(W.shape[1]))
    return reduce_blocks(names, ("",) * len(names), joints, OWN, [(W, y)])


def tsqr(rows: np.ndarray) -> np.ndarray:
    factor = np.zeros((0, rows.shape[1]))
    for start in range(0, len(rows), BLOCK):
        factor = np.asarray(np.linalg.qr(np.vstack([factor, rows[start : start + BLOCK]]), mode="r"))
    return factor


def all_rows(W: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.column_stack([W.reshape(-1, W.shape[2]), y.reshape(-1)])


@pytest.mark.benchmark(group="reduction of 100000 x 70")
def test_reduction(benchmark, rows):
    assert len(benchmark(reduced, *rows).factors) == JOINTS


@pytest.mark.benchmark(group="reduction of 100000 x 70")
def test_tsqr_in_blocks_of_1400_rows(benchmark, rows):
    whole = all_rows(*rows)
    assert benchmark(tsqr, whole).shape == (71, 71)


@pytest.mark.benchmark(group="reduction of 100000 x 70")
def test_full_qr(benchmark, rows):
    whole = all_rows(*rows)
    assert benchmark(lambda: np.linalg.qr(whole, mode="r")).shape == (71, 71)


def test_all_three_have_the_same_products(rows):
    whole = all_rows(*rows)
    for factor in (reduced(*rows).factor(), tsqr(whole)):
        np.testing.assert_allclose(factor.T @ factor, whole.T @ whole, atol=1e-9 * float(np.sum(whole**2)))


@pytest.mark.benchmark(group="refit")
def test_refit_from_the_factors(benchmark, rows):
    assert benchmark(refit, reduced(*rows)).base.rank == BASE * (len(EDGES) - 1)
