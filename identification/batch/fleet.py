"""Finds the robots of a fleet that differ from the others, and the robots that changed, from many diagnoses.

Each folder of recordings is one robot. The order of the recordings' names is their order in time. A size is a parameter
of a finding. If a recording lacks a finding that occurs elsewhere in the fleet, its size is zero, with the standard
deviation of the recordings with this finding. There is an exception: backlash of a joint, for example, may have been
found in the place of compliance. A recording is left out if it has another finding on the same joint that never occurs
together with the missing one.

A robot differs if its mean size differs significantly from the mean sizes of the other robots (Student's t-test of one
new value, 5 % over all robots and sizes, at least three other robots).

A robot changed if its sizes have a significant step or begin to drift steadily. The step or drift is fitted to the
robot's recordings by weighted least squares. Its probability by chance is the share of random series without a change
that have an equally good fit. Random series are drawn from the deviations of the other robots' recordings from their
means; with fewer than three other robots, they are the robot's recordings in random order. The level is 5 % over all
robots and sizes (Holm's procedure). At least six recordings are needed; with random order, even eight recordings seldom
suffice for a step. A single deviating recording is no change.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.special import ndtri, stdtr

from identification.batch.diagnose_each import DiagnosedRecordings
from identification.diagnosis.result import EffectAt
from identification.words.diagnosis_words import capital, parameter_name, placed_effect
from phantom_dyn.array_types import Array, Float

LEVEL = 0.05
"""Probability of any false alarm over all robots and sizes of a fleet, for each of the two tests."""
_FEWEST_OTHERS = 3
"""Smallest number of other robots from which a spread is estimated."""
_FEWEST_FOR_SCATTER = 3
"""Smallest number of recordings of another robot for an estimate of its scatter."""
_FEWEST_FOR_CHANGE = 6
"""Smallest number of recordings of a robot that is tested for changes."""
ORDERS = 4999
"""Number of random series; a probability of 0.01 is then accurate to about a tenth of its value."""
_MOST_ORDERS = 199_999
"""Largest number of random series. It limits the smallest probability that can be measured, so with more than a
thousand sizes no change is significant."""
_PER_LEVEL = 10
"""Expected number of random series below the strictest significance level; it determines the number of series."""


class Size(NamedTuple):
    """A parameter of a finding."""

    effect: str
    joint: str | None
    parameter: str
    unit: str


@dataclass(frozen=True)
class Series:
    """One size in all recordings of one robot, in the order of the recordings' names.

    Attributes:
        robot: Name of the robot's folder.
        finding: Effect and joint in words.
        parameter: Name of the parameter in words.
        unit: Unit of the size.
        logs: Names of the recordings.
        values: Sizes; zero for recordings without the finding.
        stds: Standard deviations of the sizes.
    """

    robot: str
    finding: str
    parameter: str
    unit: str
    logs: tuple[str, ...]
    values: Float[Array, " n"]
    stds: Float[Array, " n"]

    @property
    def quantity(self) -> str:
        """Finding and parameter in words."""
        return f"{self.finding} ({self.parameter})"


@dataclass(frozen=True)
class OutOfLine:
    """A robot with a size that differs from the other robots.

    Attributes:
        robot: Name of the robot.
        quantity: Finding and parameter in words.
        unit: Unit of the size.
        value: Mean size of the robot.
        others: Mean of the mean sizes of the other robots.
        p: Probability of a difference this large by chance.
    """

    robot: str
    quantity: str
    unit: str
    value: float
    others: float
    p: float


@dataclass(frozen=True)
class Change:
    """A robot with a size that changed.

    Attributes:
        robot: Name of the robot.
        quantity: Finding and parameter in words.
        unit: Unit of the size.
        drifts: True for a drift, False for a step.
        since: Name of the first recording after a step, or of the last recording before a drift.
        first: Index of the recording ``since`` among the robot's recordings.
        before: Fitted size before the change.
        after: Fitted size after a step, or at the last recording of a drift.
        p: Probability of an equally good fit by chance.
    """

    robot: str
    quantity: str
    unit: str
    drifts: bool
    since: str
    first: int
    before: float
    after: float
    p: float


@dataclass(frozen=True)
class ChangePoint:
    """The best-fitting step or drift of a series; attributes have the same meaning as in `Change`."""

    drifts: bool
    first: int
    before: float
    after: float
    p: float


def series_of(result: DiagnosedRecordings) -> tuple[Series, ...]:
    """Series of each robot and size, from the sizes of all findings.

    Args:
        result: The diagnoses; refused recordings are left out.
    """
    rows = [row for row in result.rows if row.document is not None]
    robots: dict[str, list[Any]] = {}
    for row in rows:
        robots.setdefault(str(Path(row.log).parent), []).append(row)
    sizes = {row.log: _sizes(row.document) for row in rows}
    seen: dict[Size, list[float]] = {}
    for found in sizes.values():
        for key, (_, std) in found.items():
            seen.setdefault(key, []).append(std)
    names = short_names(robots)
    out = []
    for folder, of_robot in robots.items():
        of_robot = sorted(of_robot, key=lambda row: Path(row.log).name)
        for key, stds in seen.items():
            typical_std = float(np.median(stds))
            found_together = {other.effect for found in sizes.values() if key in found for other in found}
            # Without the finding a size is zero, unless another effect on the joint may replace the finding.
            known_rows = [
                row
                for row in of_robot
                if key in sizes[row.log] or _effects_on(key.joint, sizes[row.log]) <= found_together
            ]
            if not known_rows:
                continue
            values, deviations = np.array([sizes[row.log].get(key, (0.0, typical_std)) for row in known_rows]).T
            logs = tuple(Path(row.log).name for row in known_rows)
            finding, parameter = capital(placed_effect(EffectAt(key.effect, key.joint))), parameter_name(key.parameter)
            out.append(Series(names[folder], finding, parameter, key.unit, logs, values, deviations))
    return tuple(out)


def out_of_line(series: tuple[Series, ...]) -> tuple[OutOfLine, ...]:
    """Robots whose mean size differs from the mean sizes of the other robots, the most significant first.

    Args:
        series: Series of all robots.
    """
    tested = []
    for quantity in dict.fromkeys(one.quantity for one in series):
        of_robots = [one for one in series if one.quantity == quantity]
        means = np.array([one.values.mean() for one in of_robots])
        # Standard deviation of each robot's mean, from the standard deviations of its recordings.
        noise = np.array([float(np.sqrt(np.sum(one.stds**2))) / len(one.stds) for one in of_robots])
        for k, one in enumerate(of_robots):
            others = np.delete(means, k)
            if len(others) < _FEWEST_OTHERS:
                continue
            spread = others.var(ddof=1) * (1 + 1 / len(others)) + noise[k] ** 2
            score = abs(means[k] - others.mean()) / np.sqrt(spread) if spread > 0 else np.inf
            p = 2 * float(stdtr(len(others) - 1, -score)) if means[k] != others.mean() else 1.0
            tested.append(OutOfLine(one.robot, quantity, one.unit, float(means[k]), float(others.mean()), p))
    return tuple(sorted((one for one in tested if one.p * len(tested) <= LEVEL), key=lambda one: one.p))


def changes(series: tuple[Series, ...]) -> tuple[Change, ...]:
    """Robots whose size changed, the most significant first.

    By Holm's procedure over all robots and sizes, the smallest of m probabilities is compared with a level of 5 % / m,
    the next one with 5 % / (m - 1), and so on until one is above its level. At most one of twenty fleets without
    changes then has a false alarm.

    Args:
        series: Series of all robots.
    """
    tested = [one for one in series if len(one.values) >= _FEWEST_FOR_CHANGE]
    orders = int(np.clip(_PER_LEVEL * len(tested) / LEVEL, ORDERS, _MOST_ORDERS))
    scatters = [
        _scatter([other for other in series if other.quantity == one.quantity and other.robot != one.robot])
        for one in tested
    ]
    found = [_with_enough_draws(one, scatter, orders) for one, scatter in zip(tested, scatters, strict=True)]
    out = []
    for place, k in enumerate(np.argsort([point.p for point in found], kind="stable").tolist()):
        point, one, scatter = found[k], tested[k], scatters[k]
        if point.p > LEVEL / (len(tested) - place):
            break
        if scatter is not None and not _significant_without_any(one, scatter):
            continue
        out.append(
            Change(one.robot, one.quantity, one.unit, point.drifts, one.logs[point.first], point.first, point.before,
                   point.after, point.p)
        )  # fmt: skip
    return tuple(out)


def _with_enough_draws(one: Series, scatter: Float[Array, " m"] | None, orders: int) -> ChangePoint:
    """The best-fitting change, with its probability from few draws or, if it is small, from ``orders`` draws."""
    by_few = change_point(one.values, one.stds, scatter)
    as_good = by_few.p * (1 + ORDERS)  # number of draws with a fit as good as that of the recordings
    if orders > ORDERS and as_good <= 2 * _PER_LEVEL:
        return change_point(one.values, one.stds, scatter, orders)
    return by_few


def _significant_without_any(one: Series, scatter: Float[Array, " m"]) -> bool:
    """True if the change remains significant after any single recording is left out."""
    return all(
        change_point(np.delete(one.values, k), np.delete(one.stds, k), scatter).p <= LEVEL
        for k in range(len(one.values))
    )


def change_point(
    values: Float[Array, " n"],
    stds: Float[Array, " n"],
    scatter: Float[Array, " m"] | None = None,
    orders: int = ORDERS,
) -> ChangePoint:
    """Fits the best step or drift to a series, and computes the probability of an equally good fit by chance.

    Args:
        values: Sizes in the order of time.
        stds: Standard deviations of the sizes, which determine their weights.
        scatter: Deviations from the mean of robots that do not change, from which random series are drawn. With None,
            random series are the values in random order.
        orders: Number of random series.
    """
    # No recording gets a higher weight than the median one: a single very certain size would outweigh all others.
    typical_std = float(np.median(stds))
    weights = 1.0 / np.maximum(stds, typical_std if typical_std > 0 else 1.0) ** 2
    others_square = 0.0 if scatter is None else float(np.median(weights) * scatter @ scatter)
    best, place, levels = _best_change(values[None], weights[None], others_square)
    rng = np.random.default_rng(0)
    as_good, remaining = 0, orders
    while remaining > 0:
        count = min(remaining, ORDERS)
        chance, _, _ = _best_change(*_drawn(rng, values, weights, scatter, count), others_square)
        # The factor counts fits that differ only by rounding as equally good.
        as_good += int(np.sum(chance >= best[0] * (1 - 1e-9)))
        remaining -= count
    drifts, first = divmod(int(place[0]), len(values))
    # A level much smaller than all sizes is a rounding error of zero.
    before, after = np.where(np.abs(levels[0]) > 1e-9 * np.abs(values).max(), levels[0], 0.0).tolist()
    return ChangePoint(bool(drifts), first, before, after, (1 + as_good) / (1 + orders))


def _drawn(
    rng: np.random.Generator,
    values: Float[Array, " n"],
    weights: Float[Array, " n"],
    scatter: Float[Array, " m"] | None,
    count: int,
) -> tuple[Float[Array, "k n"], Float[Array, "k n"]]:
    """Values and weights of random series without a change, one row per series.

    Args:
        rng: Random number generator.
        values: Sizes of the robot's recordings in the order of time.
        weights: Weight of each size.
        scatter: Deviations from which values are drawn; None to permute the robot's recordings.
        count: Number of series.
    """
    length = len(values)
    if scatter is None:
        orders = rng.permuted(np.tile(np.arange(length), (count, 1)), axis=1)
        return values[orders], weights[orders]
    # The scatter is known from a limited number of recordings only. With this factor, normal deviations get Student's
    # distribution.
    factor = np.sqrt(len(scatter) / rng.chisquare(len(scatter), (count, 1)))
    return rng.choice(scatter, (count, length)) * factor, np.tile(weights, (count, 1))


def _best_change(
    values: Float[Array, "k n"], weights: Float[Array, "k n"], others_square: float
) -> tuple[Array, Array, Array]:
    """Fits all steps and drifts to each series and returns the best one.

    A step has at least two values on either side; a drift has at least three values after its beginning.

    Args:
        values: Sizes in the order of time, one series per row.
        weights: Weight of each value.
        others_square: Weighted sum of squares of other robots' deviations, which is added to that of each series.

    Returns:
        Share of the weighted sum of squares that the change explains, position of the change, and the levels before
        and after. A position below ``n`` is the index of the first value after a step. A position of ``n + k`` means
        that ``k`` is the index of the last value before a drift.
    """
    count = values.shape[1]
    at = np.arange(count)
    steps, drifts = range(2, count - 1), range(count - 3)
    shapes = np.array([*((at >= k).astype(float) for k in steps), *(np.maximum(at - k, 0.0) for k in drifts)])
    # Subtracting the mean of each shape reduces rounding errors in the weighted sums below.
    shapes -= shapes.mean(axis=1, keepdims=True)
    places = np.array([*steps, *(count + k for k in drifts)])
    total_weight = weights.sum(axis=1, keepdims=True)
    mean = (weights * values).sum(axis=1, keepdims=True) / total_weight
    shape_mean = weights @ shapes.T / total_weight
    shape_square = weights @ (shapes**2).T - shape_mean**2 * total_weight
    slope = (weights * (values - mean)) @ shapes.T / shape_square
    gains = slope**2 * shape_square
    starts, ends = (mean + slope * (shapes[:, end] - shape_mean) for end in (0, -1))
    rows = np.arange(len(values))
    best = np.argmax(gains, axis=1)
    levels = np.stack([starts[rows, best], ends[rows, best]], axis=1)
    squares = (weights * (values - mean) ** 2).sum(axis=1) + others_square
    return gains[rows, best] / np.maximum(squares, 1e-300), places[best], levels


def _scatter(others: list[Series]) -> Float[Array, " m"] | None:
    """Deviations of other robots' recordings from each robot's mean; None with fewer than three other robots."""
    several = [one for one in others if len(one.values) >= _FEWEST_FOR_SCATTER]
    if len(several) < _FEWEST_OTHERS:
        return None
    # The factor corrects for the mean, which is computed from the same recordings.
    parts = [(v - v.mean()) * np.sqrt(len(v) / (len(v) - 1)) for v in (one.values for one in several)]
    deviations = np.concatenate(parts)
    typical_std = float(np.median(np.concatenate([one.stds for one in several])))
    # Robots without the finding have only zeros. Normal deviations with the typical standard deviation replace these.
    if float(np.sqrt(np.mean(deviations**2))) < typical_std:
        return typical_std * np.asarray(ndtri((np.arange(len(deviations)) + 0.5) / len(deviations)))
    return deviations


def _sizes(document: Any) -> dict[Size, tuple[float, float]]:
    """Value and standard deviation of every parameter of the findings; parameters that are lists are left out."""
    out = {}
    for finding in document["findings"]:
        for name, size in finding["parameters"].items():
            value, std = size["value"], size["std"]
            if isinstance(value, int | float) and isinstance(std, int | float):
                out[Size(finding["effect"], finding["joint"], name, size["unit"])] = (float(value), float(std))
    return out


def _effects_on(joint: str | None, found: Iterable[Size]) -> set[str]:
    """Effects that were found on a joint."""
    return {one.effect for one in found if one.joint == joint}


def short_names(folders: Iterable[str]) -> dict[str, str]:
    """The last part of each path, or the whole path if several paths have the same last part."""
    folders = list(folders)
    last = {folder: Path(folder).name or folder for folder in folders}
    twice = {name for name in last.values() if list(last.values()).count(name) > 1}
    return {folder: folder if name in twice else name for folder, name in last.items()}
