"""Estimates the noise of measured poses without a model, from repeated poses or from second differences of a motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification.geometry.judgement import ExplainedPoses
from phantom_dyn.array_types import Array, Float
from phantom_dyn.random_streams import random_stream

_SAME = 1e-4  # poses count as repeated if their joint positions, rounded to this [rad or m], are equal
_FEWEST = 6  # least degrees of freedom for an estimate of the noise
_POSES = 300  # largest number of poses in `depends_on_posture`
_SHUFFLES = 199  # number of random orders of the poses in `depends_on_posture`
_LEAST_PREDICTED = 0.15
"""The residual may depend on the posture if the posture predicts at least this share of it on held-out poses."""


@dataclass(frozen=True)
class Floor:
    """Noise of one coordinate of a series [m or rad], its 95 % interval, and the name of the method."""

    sigma: float
    interval: tuple[float, float]
    source: str


def floor_of(explained: ExplainedPoses, series: int) -> Floor:
    """Noise of one series of poses; if no pose is repeated, the noise is that of the fit of all terms.

    Args:
        explained: Fit of few terms to the poses.
        series: Twice the index of the set of poses, plus one for orientations.
    """
    one = explained.problem.sets[series // 2]
    residual = _residual(explained, series)
    if one.moving:
        # A second difference of white noise has the variance 1 + 4 + 1 = 6, in units of the variance of the noise.
        second = residual[2:] - 2 * residual[1:-1] + residual[:-2]
        return _floor(float(np.sqrt(np.mean(second**2) / 6.0)), second.size / 2.0, "above_band")
    groups = _repeated(one.q)
    squares = sum(float(np.sum((residual[group] - residual[group].mean(axis=0)) ** 2)) for group in groups)
    free = 3.0 * sum(len(group) - 1 for group in groups)
    if free >= _FEWEST:
        return _floor(float(np.sqrt(squares / free)), free, "repetitions")
    return _floor(float(explained.noise.sigma[series]), explained.noise.degrees_of_freedom, "predictors")


def _residual(explained: ExplainedPoses, series: int) -> Float[Array, "n 3"]:
    """Residual of one series, one row for each pose."""
    linearised = explained.linearised
    return linearised.residual[linearised.series == series].reshape(-1, 3)


def _repeated(q: Float[Array, "n nv"]) -> list[list[int]]:
    """Groups of two or more poses with the same joint positions."""
    groups: dict[tuple[int, ...], list[int]] = {}
    for k, key in enumerate(np.round(q / _SAME).astype(int).tolist()):
        groups.setdefault(tuple(key), []).append(k)
    return [group for group in groups.values() if len(group) > 1]


def _floor(sigma: float, free: float, source: str) -> Floor:
    """The noise with its 95 % interval by the chi-squared distribution with ``free`` degrees of freedom."""
    from scipy.special import chdtri

    low, high = (sigma * float(np.sqrt(free / chdtri(free, p))) for p in (0.025, 0.975))
    return Floor(sigma, (low, high), source)


def depends_on_posture(explained: ExplainedPoses) -> bool:
    """True if joint positions predict the residuals of held-out poses better than residuals in random order.

    A smooth function of the posture (ridge regression on Gaussian kernels) is fitted to nine tenths of the poses and
    predicts the remaining tenth.

    Args:
        explained: The fit with its residuals.
    """
    return any(_is_predicted(explained, number) for number in range(len(explained.problem.sets)))


def _is_predicted(explained: ExplainedPoses, number: int) -> bool:
    """The test of `depends_on_posture` for one set of poses."""
    one, linearised = explained.problem.sets[number], explained.linearised
    own = linearised.series // 2 == number
    poses = np.unique(linearised.pose[own & explained.kept])
    poses = poses[np.linspace(0, len(poses) - 1, min(len(poses), _POSES)).astype(int)]
    weighted = linearised.residual / explained.noise.sigma[linearised.series]
    y = np.array([weighted[own & (linearised.pose == pose)] for pose in poses])
    predict = _predictor(one.q[poses - linearised.pose[own].min()])
    rng = random_stream("shuffled poses")
    total = float(np.sum(y**2))

    def predicted_share(values: Array) -> float:
        return 1.0 - float(np.sum((values - predict @ values) ** 2)) / max(total, 1e-300)

    share = predicted_share(y)
    if share < _LEAST_PREDICTED:
        return False
    return share > max(predicted_share(y[rng.permutation(len(y))]) for _ in range(_SHUFFLES))


def _predictor(q: Float[Array, "n nv"]) -> Float[Array, "n n"]:
    """Matrix that predicts the residual of each pose from the residuals of the nine other blocks of poses."""
    n = len(q)
    size = np.ptp(q, axis=0)
    scaled = q / np.where(size > 0, size, 1.0)
    distance = np.sum((scaled[:, None] - scaled[None]) ** 2, axis=2)
    kernel = np.exp(-distance / np.median(distance[distance > 0])) if np.any(distance > 0) else np.ones((n, n))
    block = np.arange(n) * 10 // n
    out = np.zeros((n, n))
    for b in np.unique(block):
        own, rest = np.flatnonzero(block == b), np.flatnonzero(block != b)
        out[np.ix_(own, rest)] = np.linalg.solve(
            kernel[np.ix_(rest, rest)] + np.eye(len(rest)), kernel[np.ix_(rest, own)]
        ).T
    return out
