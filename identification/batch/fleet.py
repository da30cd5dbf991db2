"""Many diagnoses of a fleet: which robot is out of line with the others, and which one changed, and since when.

A robot is the folder that its recordings lie in, and their time is the order of their names. A recording that lacks a
finding that others have counts as nothing, with the deviation of those that have it; it does not count where it has
another finding on that joint, which may stand for the missing one. Out of line is a robot whose mean
size differs from those of the others by more than their spread explains (Student's test of one new value, at 5 % over
all robots and sizes; at least three others). A change is the one split of a robot's recordings that leaves the least
squares, as binary segmentation finds first; its level is that of the same recordings in random orders (at 5 % over the
sizes of the robot; at least six recordings, and fewer than eight rarely show anything).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.stats import t as student

from identification.batch.diagnose_each import DiagnosedRecordings

Array = np.ndarray

LEVEL = 0.05
"""False alarms, over all robots and sizes (out of line) or over the sizes of one robot (changes)."""
_OTHERS = 3
"""Robots beside the one that is judged: from fewer no spread is known."""
_FEWEST = 6
"""Recordings of a robot before a change is looked for."""
_ORDERS = 4999
"""Random orders, so that a level of one in a thousand is known to a tenth of it."""


@dataclass(frozen=True)
class Series:
    """One size of one finding in all recordings of one robot, in the order of their names.

    Attributes:
        robot: Name of its folder.
        quantity: Effect, joint and parameter.
        unit: Of the size.
        logs: Names of the recordings.
        values: Sizes, zero where the finding is missing.
        stds: Their standard deviations.
    """

    robot: str
    quantity: str
    unit: str
    logs: tuple[str, ...]
    values: Float[Array, " n"]
    stds: Float[Array, " n"]


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
    """A robot whose size changed at one of its recordings."""

    robot: str
    quantity: str
    unit: str
    since: str
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
    seen: dict[tuple[str, str, str], list[float]] = {}
    joints = {row.log: {key[2] for key in sizes[row.log]} for row in rows}
    for found in sizes.values():
        for key, (_, std) in found.items():
            seen.setdefault(key, []).append(std)
    names = _short_names(robots)
    out = []
    for folder, own in robots.items():
        own = sorted(own, key=lambda row: Path(row.log).name)
        for key, stds in seen.items():
            quantity, unit, joint = key
            usual = float(np.median(stds))
            # Another finding on that joint may stand for the missing one.
            told = [row for row in own if key in sizes[row.log] or joint not in joints[row.log]]
            if not told:
                continue
            values, deviations = np.array([sizes[row.log].get(key, (0.0, usual)) for row in told]).T
            logs = tuple(Path(row.log).name for row in told)
            out.append(Series(names[folder], quantity, unit, logs, values, deviations))
    return tuple(out)


def out_of_line(series: tuple[Series, ...]) -> tuple[OutOfLine, ...]:
    """Robots whose mean size differs from those of the others, the surest first.

    Args:
        series: Of all robots.
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
            p = 2 * float(student.sf(score, len(others) - 1)) if means[k] != others.mean() else 1.0
            tested.append(OutOfLine(one.robot, quantity, one.unit, float(means[k]), float(others.mean()), p))
    return tuple(sorted((one for one in tested if one.p * len(tested) <= LEVEL), key=lambda one: one.p))


def changes(series: tuple[Series, ...]) -> tuple[Change, ...]:
    """Robots whose size changed, and the first recording after it, the surest first.

    Args:
        series: Of all robots.
    """
    out = []
    for robot in dict.fromkeys(one.robot for one in series):
        own = [one for one in series if one.robot == robot and len(one.values) >= _FEWEST]
        for one in own:
            split, p = change_point(one.values, one.stds)
            if p * len(own) <= LEVEL:
                before, after = float(one.values[:split].mean()), float(one.values[split:].mean())
                out.append(Change(robot, one.quantity, one.unit, one.logs[split], before, after, p))
    return tuple(sorted(out, key=lambda one: one.p))


def change_point(values: Float[Array, " n"], stds: Float[Array, " n"]) -> tuple[int, float]:
    """Index of the first value after the likeliest change of the mean, and how often chance does as well.

    Args:
        values: In the order of time.
        stds: Their standard deviations, which weigh them.
    """
    least = float(np.median(stds))
    weights = 1.0 / np.maximum(stds, least if least > 0 else 1.0) ** 2
    best, split = _best_split(values[None], weights[None])
    rng = np.random.default_rng(0)
    orders = rng.permuted(np.tile(np.arange(len(values)), (_ORDERS, 1)), axis=1)
    chance, _ = _best_split(values[orders], weights[orders])
    # Rounding makes equal orders differ.
    as_good = int(np.sum(chance >= best[0] * (1 - 1e-9)))
    return int(split[0]), (1 + as_good) / (1 + _ORDERS)


def _best_split(values: Float[Array, "k n"], weights: Float[Array, "k n"]) -> tuple[Array, Array]:
    """Largest drop of the weighted squares by two means in place of one, and where the second begins."""
    sums, mass = np.cumsum(weights * values, axis=1), np.cumsum(weights, axis=1)
    first, second = sums[:, :-1] / mass[:, :-1], (sums[:, -1:] - sums[:, :-1]) / (mass[:, -1:] - mass[:, :-1])
    gain = mass[:, :-1] * (mass[:, -1:] - mass[:, :-1]) / mass[:, -1:] * (first - second) ** 2
    at = gain.argmax(axis=1)
    return gain[np.arange(len(gain)), at], at + 1


def _sizes(document: Any) -> dict[tuple[str, str, str], tuple[float, float]]:
    """Value and deviation of every number of the findings, by quantity, unit and joint; lists are left out."""
    out = {}
    for finding in document["findings"]:
        for name, size in finding["parameters"].items():
            value, std = size["value"], size["std"]
            if isinstance(value, int | float) and isinstance(std, int | float):
                words = (finding["effect"], finding["joint"], name)
                key = " ".join(filter(None, words)).replace("_", " "), size["unit"], finding["joint"] or ""
                out[key] = (float(value), float(std))
    return out


def _short_names(folders: Iterable[str]) -> dict[str, str]:
    """The last part of each folder, the whole of it where that names several."""
    folders = list(folders)
    last = {folder: Path(folder).name or folder for folder in folders}
    twice = {name for name in last.values() if list(last.values()).count(name) > 1}
    return {folder: folder if name in twice else name for folder, name in last.items()}
