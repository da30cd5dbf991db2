"""Writes ``fleet.html``: robots of a fleet that differ from the others or changed, and a chart of each size."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np

from identification.batch.diagnose_each import DiagnosedRecordings
from identification.batch.fleet import ORDERS, Change, OutOfLine, Series, changes, out_of_line, series_of, short_names
from identification.reporting.charts.chart import Panel, chart, short_name
from identification.reporting.charts.chart_marks import Curve
from identification.reporting.plain_page import figure, html_list, page, table
from identification.words.diagnosis_words import joined
from identification.words.numbers_and_names import number, with_unit
from phantom_dyn.array_types import Array

_SIZE = (9.4, 3.0)  # width and height of a chart [inch]
_COLOURS = ("#d55e00", "#0072b2", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
"""Colours of Okabe and Ito, which people with any kind of colour vision can distinguish."""
_OTHERS = "#808080"
_INTERVAL = 1.96  # half the width of a 95 % interval, in standard deviations
_HOW = (
    "<p>A robot is the folder of its recordings, and their time is the order of their names. Out of line is a robot "
    "whose mean size lies outside what the spread of at least three others explains (Student's test, at 5 % over all). "
    "A change is a step or the beginning of a drift in at least six recordings of one robot that recordings without "
    "a change rarely show (at 5 % over the robot's sizes).</p>"
)


def fleet_page(result: DiagnosedRecordings) -> str:
    """The page as self-contained HTML.

    Args:
        result: Diagnoses of recordings; a robot is the folder of its recordings.
    """
    series = series_of(result)
    outliers, changed = out_of_line(series), changes(series)
    count, robots = len(result.rows), len(set(_folders(result)))
    sentences = [*map(_outlier_words, outliers), *map(_change_words, changed)]
    parts = [
        html_list(sentences) if sentences else "<p>No robot is out of line with the others, and none changed.</p>",
        "<h2>Robots</h2>",
        _robots_table(result, outliers, changed),
    ]
    if series:
        parts += [
            "<h2>Sizes over time</h2>",
            "<p>Points are recordings, bars 95 % intervals; a recording without the finding counts as zero. Robots in "
            "colour are out of line or changed, grey ones are not; a dashed line is the level before and after.</p>",
        ]
    # Sizes of robots that are out of line or changed come first.
    quantities = sorted(
        dict.fromkeys(one.quantity for one in series),
        key=lambda quantity: not any(one.quantity == quantity for one in (*outliers, *changed)),
    )
    for quantity in quantities:
        of_quantity = [one for one in series if one.quantity == quantity]
        parts.append(_figure(of_quantity, [one for one in outliers if one.quantity == quantity],
                             [one for one in changed if one.quantity == quantity]))  # fmt: skip
    if not series:
        parts.append("<p>No recording has a finding with a size.</p>")
    parts += ["<h2>How this is judged</h2>", _HOW]
    words = f"{robots} {'robot' if robots == 1 else 'robots'}, {count} {'recording' if count == 1 else 'recordings'}"
    return page(f"{result.robot}: {words}", parts)


def fleet_lines(result: DiagnosedRecordings) -> tuple[str, ...]:
    """Sentences for a terminal on robots that differ from the others, and on robots that changed.

    Args:
        result: Diagnoses of recordings.
    """
    series = series_of(result)
    return (*map(_outlier_words, out_of_line(series)), *map(_change_words, changes(series)))


def _outlier_words(one: OutOfLine) -> str:
    return (
        f"{one.robot} is out of line: {one.quantity} is {_sized(one.value, one.unit)}, on average of the others "
        f"{_sized(one.others, one.unit)} (by chance {_chance(one.p)})."
    )


def _change_words(one: Change) -> str:
    what = "has drifted since" if one.drifts else "changed with"
    # With n draws, no probability below about 1 / n can be measured.
    drawn = "at most " if one.p <= 1 / ORDERS else ""
    levels = f"from {number(one.before)} to {_sized(one.after, one.unit)}"
    return f"{one.robot} {what} {one.since}: {one.quantity} {levels} (by chance {drawn}{_chance(one.p)})."


def _chance(p: float) -> str:
    """A probability in words, such as ``once in 500``."""
    if p < 1e-6:
        return "less than once in a million"
    return f"once in {number(1 / p, 2)}"


def _sized(value: float, unit: str) -> str:
    return with_unit(number(value), unit)


def _folders(result: DiagnosedRecordings) -> list[str]:
    """Folder of each recording; each folder is one robot."""
    return [str(Path(row.log).parent) for row in result.rows]


def _robots_table(result: DiagnosedRecordings, outliers: tuple[OutOfLine, ...], changed: tuple[Change, ...]) -> str:
    """Table with one row per robot: number of recordings, verdicts, differences and changes."""
    of_rows = _folders(result)
    folders = list(dict.fromkeys(of_rows))
    names = short_names(folders)
    rows = []
    for folder in folders:
        verdicts = Counter(row.verdict for row, own in zip(result.rows, of_rows, strict=True) if own == folder)
        remarks = [f"out of line: {one.quantity}" for one in outliers if one.robot == names[folder]]
        remarks += [
            f"{'drifts' if one.drifts else 'changed'} since {one.since}: {one.quantity}"
            for one in changed
            if one.robot == names[folder]
        ]
        counted = joined([f"{count} {verdict.replace('_', ' ')}" for verdict, count in verdicts.items()], last=", ")
        rows.append((names[folder], str(verdicts.total()), counted, "; ".join(remarks) or "–"))
    return table(("robot", "recordings", "verdicts", "stands out"), rows)


def _figure(series: list[Series], outliers: list[OutOfLine], changed: list[Change]) -> str:
    """Draws one size of all robots with 95 % intervals; robots that differ or changed are in colour."""
    places, names = _places_and_names(series)
    marked = list(dict.fromkeys(one.robot for one in (*outliers, *changed)))
    all_in_colour = len(series) <= len(_COLOURS) and not marked
    unmarked = [one for one in series if one.robot not in marked]
    curves = []
    for k, one in enumerate(unmarked):
        # All grey robots share one entry in the legend, that of the first.
        shared_label = "other robots" if k == 0 else ""
        label, colour = (one.robot, _COLOURS[k]) if all_in_colour else (shared_label, _OTHERS)
        curves.append(_curve(one, places[one.robot] + _offset(k, len(series)), colour, label, 0.8))
    for k, robot in enumerate(marked):
        (one,) = (one for one in series if one.robot == robot)
        colour, x = _COLOURS[k % len(_COLOURS)], places[robot] + _offset(len(unmarked) + k, len(series))
        curves.append(_curve(one, x, colour, robot, 1.4))
        curves += [_levels(change, x, colour) for change in changed if change.robot == robot]
    label = f"{short_name(series[0].parameter)} [{series[0].unit}]"
    panel = Panel(label, tuple(curves), zero=True, least=(0.0,))
    x_label = "recording" if names else "recording of the robot, by the order of names"
    title = series[0].quantity
    return figure(title, chart((panel,), x_label, _SIZE, title, x_names=names),
                  [*map(_outlier_words, outliers), *map(_change_words, changed)])  # fmt: skip


def _places_and_names(series: list[Series]) -> tuple[dict[str, Array], tuple[str, ...]]:
    """Positions of each robot's recordings on the horizontal axis, and the names on the axis.

    Recordings with the same name have the same position. If recordings of different robots rarely have the same name,
    the axis has numbers instead of names.
    """
    every = sorted({log for one in series for log in one.logs})
    longest = max(len(one.logs) for one in series)
    if len(every) > 1.5 * longest and len(series) > 1:
        return {one.robot: np.arange(1.0, len(one.logs) + 1) for one in series}, ()
    at = {log: float(k) for k, log in enumerate(every)}
    names = tuple(short_name(Path(log).stem, 14) for log in every)
    return {one.robot: np.array([at[log] for log in one.logs]) for one in series}, names


def _offset(k: int, count: int) -> float:
    """Offset of the k-th robot on the horizontal axis, so that the bars of robots do not hide each other."""
    return 0.4 * ((k + 0.5) / count - 0.5)


def _curve(one: Series, x: Array, colour: str, label: str, width: float) -> Curve:
    """Curve of one robot with intervals and tooltips."""
    tips = tuple(
        f"{one.robot}, {log}: {_sized(float(value), one.unit)}" for log, value in zip(one.logs, one.values, strict=True)
    )
    half = _INTERVAL * one.stds
    return Curve(x, one.values, colour, width, label, opacity=0.6, marked=True, half=half, tips=tips)


def _levels(change: Change, x: Array, colour: str) -> Curve:
    """Dashed curve with the levels before and after a step, or with the line of a drift."""
    first, last = change.first, len(x) - 1
    if change.drifts:
        corners = [(x[0], change.before), (x[first], change.before), (x[last], change.after)]
    else:
        corners = [(x[0], change.before), (x[first - 1], change.before), (x[first], change.after),
                   (x[last], change.after)]  # fmt: skip
    across, up = np.array(corners, dtype=float).T
    return Curve(across, up, colour, 1.4, dashes="5 3")
