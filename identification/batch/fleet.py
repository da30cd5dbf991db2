"""Many diagnoses of a fleet: which robot is out of line with the others, and which one changed, and since when.

A robot is the folder that its recordings lie in, and their time is the order of their names. A recording that lacks a
finding that others have counts as nothing, with the deviation of those that have it; it does not count where it has
another finding on that joint that is never there beside the missing one, and so may stand for it. Out of line is a
robot whose mean size differs from those of the others by more than their spread explains (Student's test of one new
value, at 5 % over all robots and sizes; at least three others). A change is the one step, or the one beginning of a
steady drift, that leaves the least squares of a robot's recordings; chance is how often recordings that do not change
show one as clear: drawn from the scatter of the other robots about their means where there are three, else the same
recordings in random orders. Changes are at 5 % over all robots and sizes (Holm's procedure); they need at least six
recordings, and in random orders eight rarely show a step. A single odd recording is no change.
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
from identification.words.diagnosis_words import capital, effect_at, parameter_name
from phantom_dyn.array_types import Array, Float

LEVEL = 0.05
"""False alarms over all robots and sizes of a fleet, of robots out of line and of changes each."""
_OTHERS = 3
"""Robots beside the one that is judged: from fewer no spread is known."""
_SEVERAL = 3
"""Recordings of another robot before its scatter counts."""
_FEWEST = 6
"""Recordings of a robot before a change is looked for."""
ORDERS = 4999
"""Random orders or draws, so that a level of one in a hundred is known to a tenth of it."""
_MOST_ORDERS = 199_999
"""At most, in a fleet of many sizes: beyond a thousand of them the least chance that draws show is above the level."""
_PER_LEVEL = 10
"""Draws below the level of the strictest comparison."""


class Size(NamedTuple):
    """Which number of which finding."""

    effect: str
    joint: str | None
    parameter: str
    unit: str


@dataclass(frozen=True)
class Series:
    """One size of one finding in all recordings of one robot, in the order of their names.

    Attributes:
        robot: Name of its folder.
        finding: Effect and place in words.
        parameter: Which size of it, in words.
        unit: Unit of the size.
        logs: Names of the recordings.
        values: Sizes, zero where the finding is missing.
        stds: Their standard deviations.
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
        """Finding and parameter."""
        return f"{self.finding} ({self.parameter})"


@dataclass(frozen=True)
class OutOfLine:
    """A robot whose size differs from that of the others."""

    robot: str
    quantity: str
    unit: str
    value: float
    others: float
    p: float


@dataclass(frozen=True)
class Change:
    """A robot whose size changed.

    Attributes:
        robot: Its name.
        quantity: Finding and parameter.
        unit: Unit of the size.
        drifts: True if the size grows or falls steadily, False for a step.
        since: The first recording after a step; the last one before a drift.
        first: Its place among the recordings of the robot.
        before: Mean, or level before a drift.
        after: Mean after a step, or level that a drift has come to.
        p: Probability of such a result by chance.
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
    """The likeliest change of a series: a drift or a step, its place, the levels about it, and its chance."""

    drifts: bool
    first: int
    before: float
    after: float
    p: float


def series_of(result: DiagnosedRecordings) -> tuple[Series, ...]:
    """Sizes of all findings by robot; those that no recording has are not there.

    Args:
        result: Diagnoses; recordings that were refused are left out.
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
    for folder, own in robots.items():
        own = sorted(own, key=lambda row: Path(row.log).name)
        for key, stds in seen.items():
            usual = float(np.median(stds))
            beside = {other.effect for found in sizes.values() if key in found for other in found}
            known_rows = [row for row in own if key in sizes[row.log] or not _others(sizes[row.log], key) - beside]
            if not known_rows:
                continue
            values, deviations = np.array([sizes[row.log].get(key, (0.0, usual)) for row in known_rows]).T
            logs = tuple(Path(row.log).name for row in known_rows)
            finding, parameter = capital(effect_at(EffectAt(key.effect, key.joint))), parameter_name(key.parameter)
            out.append(Series(names[folder], finding, parameter, key.unit, logs, values, deviations))
    return tuple(out)


def out_of_line(series: tuple[Series, ...]) -> tuple[OutOfLine, ...]:
    """Robots whose mean size differs from those of the others, the surest first.

    Args:
        series: Time series of all robots.
    """
    tested = []
    for quantity in dict.fromkeys(one.quantity for one in series):
        of_robots = [one for one in series if one.quantity == quantity]
        means = np.array([one.values.mean() for one in of_robots])
        # A mean of recordings is no surer than their own deviations say.
        noise = np.array([float(np.sqrt(np.sum(one.stds**2))) / len(one.stds) for one in of_robots])
        for k, one in enumerate(of_robots):
            others = np.delete(means, k)
            if len(others) < _OTHERS:
                continue
            spread = others.var(ddof=1) * (1 + 1 / len(others)) + noise[k] ** 2
            score = abs(means[k] - others.mean()) / np.sqrt(spread) if spread > 0 else np.inf
            p = 2 * float(stdtr(len(others) - 1, -score)) if means[k] != others.mean() else 1.0
            tested.append(OutOfLine(one.robot, quantity, one.unit, float(means[k]), float(others.mean()), p))
    return tuple(sorted((one for one in tested if one.p * len(tested) <= LEVEL), key=lambda one: one.p))


def changes(series: tuple[Series, ...]) -> tuple[Change, ...]:
    """Robots whose size changed, the surest first; any false one in one of twenty fleets that do not change.

    Holm's procedure over all robots and sizes: the surest of m changes is held against a level of 5 % / m, the next
    one against 5 % / (m - 1), until one is not sure enough.

    Args:
        series: Time series of all robots.
    """
    tested = [one for one in series if len(one.values) >= _FEWEST]
    orders = int(np.clip(_PER_LEVEL * len(tested) / LEVEL, ORDERS, _MOST_ORDERS))
    scatters = [
        _scatter([other for other in series if other.quantity == one.quantity and other.robot != one.robot])
        for one in tested
    ]
    found = [_surely(one, scatter, orders) for one, scatter in zip(tested, scatters, strict=True)]
    out = []
    for place, k in enumerate(np.argsort([point.p for point in found], kind="stable").tolist()):
        point, one, scatter = found[k], tested[k], scatters[k]
        if point.p > LEVEL / (len(tested) - place):
            break
        if scatter is not None and not _without_any(one, scatter):
            continue
        out.append(
            Change(one.robot, one.quantity, one.unit, point.drifts, one.logs[point.first], point.first, point.before,
                   point.after, point.p)
        )  # fmt: skip
    return tuple(out)


def _surely(one: Series, scatter: Float[Array, " m"] | None, orders: int) -> ChangePoint:
    """The likeliest change; of one that is rare among a few draws the chance comes from as many as a fleet needs."""
    few = change_point(one.values, one.stds, scatter)
    rare = orders > ORDERS and few.p * (1 + ORDERS) <= 2 * _PER_LEVEL
    return change_point(one.values, one.stds, scatter, orders) if rare else few


def _without_any(one: Series, scatter: Float[Array, " m"]) -> bool:
    """True if a change is seen whichever recording is left out: one that is odd is no change of the robot."""
    left = (np.delete(np.arange(len(one.values)), k) for k in range(len(one.values)))
    return all(change_point(one.values[rows], one.stds[rows], scatter).p <= LEVEL for rows in left)


def change_point(
    values: Float[Array, " n"],
    stds: Float[Array, " n"],
    scatter: Float[Array, " m"] | None = None,
    orders: int = ORDERS,
) -> ChangePoint:
    """The likeliest step or beginning of a drift, and how often chance shows as clear a one.

    Args:
        values: In the order of time.
        stds: Their standard deviations, which weigh them.
        scatter: Departures of recordings that do not change from their mean; None: nothing is known of them, and the
            values in random orders take their place.
        orders: Random orders or draws.
    """
    least = float(np.median(stds))
    weights = 1.0 / np.maximum(stds, least if least > 0 else 1.0) ** 2
    known = 0.0 if scatter is None else float(np.median(weights) * scatter @ scatter)
    best, place, levels = _best_change(values[None], weights[None], known)
    rng = np.random.default_rng(0)
    as_good, left = 0, orders
    while left > 0:
        count = min(left, ORDERS)
        drawn = _drawn(rng, np.stack([values, weights]), scatter, count)
        chance, _, _ = _best_change(*drawn, known)
        # Rounding makes equal orders differ.
        as_good += int(np.sum(chance >= best[0] * (1 - 1e-9)))
        left -= count
    drifts, first = divmod(int(place[0]), len(values))
    # Sums of sizes that are all zero are rounding.
    before, after = np.where(np.abs(levels[0]) > 1e-9 * np.abs(values).max(), levels[0], 0.0).tolist()
    return ChangePoint(bool(drifts), first, before, after, (1 + as_good) / (1 + orders))


def _drawn(
    rng: np.random.Generator, own: Float[Array, "2 n"], scatter: Float[Array, " m"] | None, count: int
) -> tuple[Float[Array, "k n"], Float[Array, "k n"]]:
    """Values and weights of recordings that do not change.

    Args:
        rng: Draws them.
        own: Values and weights in the order of time.
        scatter: Departures of recordings that do not change from their mean, ``(m,)``; None: nothing is known of them.
        count: Number of draws.
    """
    length = own.shape[1]
    if scatter is None:
        orders = rng.permuted(np.tile(np.arange(length), (count, 1)), axis=1)
        return own[0][orders], own[1][orders]
    # That the scatter is known from so many recordings only widens it, as in Student's test.
    wide = np.sqrt(len(scatter) / rng.chisquare(len(scatter), (count, 1)))
    return rng.choice(scatter, (count, length)) * wide, np.tile(own[1], (count, 1))


def _best_change(values: Float[Array, "k n"], weights: Float[Array, "k n"], known: float) -> tuple[Array, Array, Array]:
    """Largest share of the weighted squares that one change takes away, its place, and the levels about it.

    A place below ``n`` is the first value after a step, from ``n`` on the last before a drift. A step has two values on
    either side, a drift three.

    Args:
        values: In the order of time, a row a series.
        weights: Weight of each value.
        known: Weighted squares of the scatter of others, beside which a change has to stand out too.
    """
    count = values.shape[1]
    at = np.arange(count)
    steps, drifts = range(2, count - 1), range(count - 3)
    shapes = np.array([*((at >= k).astype(float) for k in steps), *(np.maximum(at - k, 0.0) for k in drifts)])
    # About their plain means, so that little cancels in what is taken off for the weighted ones.
    shapes -= shapes.mean(axis=1, keepdims=True)
    places = np.array([*steps, *(count + k for k in drifts)])
    mass = weights.sum(axis=1, keepdims=True)
    mean = (weights * values).sum(axis=1, keepdims=True) / mass
    middle = weights @ shapes.T / mass
    square = weights @ (shapes**2).T - middle**2 * mass
    slope = (weights * (values - mean)) @ shapes.T / square
    gains = slope**2 * square
    starts, ends = (mean + slope * (shapes[:, end] - middle) for end in (0, -1))
    rows = np.arange(len(values))
    best = np.argmax(gains, axis=1)
    levels = np.stack([starts[rows, best], ends[rows, best]], axis=1)
    squares = (weights * (values - mean) ** 2).sum(axis=1) + known
    return gains[rows, best] / np.maximum(squares, 1e-300), places[best], levels


def _scatter(others: list[Series]) -> Float[Array, " m"] | None:
    """Departures of the recordings of other robots from their means; None from fewer than three robots."""
    several = [one for one in others if len(one.values) >= _SEVERAL]
    if len(several) < _OTHERS:
        return None
    # About a mean of their own recordings scatter too little.
    parts = [(v - v.mean()) * np.sqrt(len(v) / (len(v) - 1)) for v in (one.values for one in several)]
    apart = np.concatenate(parts)
    usual = float(np.median(np.concatenate([one.stds for one in several])))
    # Where the finding is missing all sizes are zero, and yet none is surer than its deviation.
    if float(np.sqrt(np.mean(apart**2))) < usual:
        return usual * np.asarray(ndtri((np.arange(len(apart)) + 0.5) / len(apart)))
    return apart


def _sizes(document: Any) -> dict[Size, tuple[float, float]]:
    """Value and deviation of every number of the findings; lists are left out."""
    out = {}
    for finding in document["findings"]:
        for name, size in finding["parameters"].items():
            value, std = size["value"], size["std"]
            if isinstance(value, int | float) and isinstance(std, int | float):
                out[Size(finding["effect"], finding["joint"], name, size["unit"])] = (float(value), float(std))
    return out


def _others(found: Iterable[Size], key: Size) -> set[str]:
    """Effects that were found on the joint of a size in its place."""
    return {one.effect for one in found if one.joint == key.joint}


def short_names(folders: Iterable[str]) -> dict[str, str]:
    """The last part of each folder, the whole of it where that names several."""
    folders = list(folders)
    last = {folder: Path(folder).name or folder for folder in folders}
    twice = {name for name in last.values() if list(last.values()).count(name) > 1}
    return {folder: folder if name in twice else name for folder, name in last.items()}
