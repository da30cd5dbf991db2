"""``fleet.html``: one page for many diagnoses, with who is out of line, what changed since when, and a chart a size."""

from __future__ import annotations

from html import escape

import numpy as np

from identification.batch.diagnose_each import DiagnosedRecordings
from identification.batch.fleet import Series, changes, out_of_line, series_of

_WIDTH, _HEIGHT, _EDGE = 640.0, 180.0, 44.0
_COLOURS = ("#1b6ca8", "#c8553d", "#3a7d44", "#7d4f9e", "#a67c00", "#4a4a4a", "#008080", "#b03060")
_STYLE = (
    "body{font-family:sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem}table{border-collapse:collapse}"
    "td,th{padding:.2rem .7rem;text-align:left;border-bottom:1px solid #ccc}svg{width:100%;height:auto}"
)


def fleet_page(result: DiagnosedRecordings) -> str:
    """The page as self-contained HTML.

    Args:
        result: Diagnoses of recordings; a robot is the folder that they lie in.
    """
    series = series_of(result)
    robots = list(dict.fromkeys(one.robot for one in series))
    count = len(result.rows) - len(result.refused)
    parts = [
        f"<h1>{escape(result.robot)}: {count} recordings of {max(len(robots), 1)} robots</h1>",
        "<p>A robot is the folder of its recordings, and their time is the order of their names.</p>",
        "<h2>Out of line</h2>",
        _outliers(series),
        "<h2>Changes</h2>",
        _changed(series),
        "<h2>Sizes over time</h2>",
    ]
    for quantity in dict.fromkeys(one.quantity for one in series):
        own = [one for one in series if one.quantity == quantity]
        parts += [f"<h3>{escape(quantity)} [{escape(own[0].unit)}]</h3>", _chart(own, robots)]
    if not series:
        parts.append("<p>No recording has a finding with a size.</p>")
    head = f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>Fleet</title><style>{_STYLE}</style>'
    return head + "</head><body>\n" + "\n".join(parts) + "\n</body></html>\n"


def fleet_lines(result: DiagnosedRecordings) -> tuple[str, ...]:
    """Sentences for a terminal on robots out of line and on changes; none where there are none.

    Args:
        result: Diagnoses of recordings.
    """
    series = series_of(result)
    lines = [
        f"{one.robot} is out of line: {one.quantity} {one.value:.3g} {one.unit}, the others {one.others:.3g}."
        for one in out_of_line(series)
    ]
    lines += [
        f"{one.robot} changed with {one.since}: {one.quantity} from {one.before:.3g} to {one.after:.3g} {one.unit}."
        for one in changes(series)
    ]
    return tuple(lines)


def _outliers(series: tuple[Series, ...]) -> str:
    rows = [
        (one.robot, one.quantity, f"{one.value:.3g} {one.unit}", f"{one.others:.3g} {one.unit}", f"{one.p:.1g}")
        for one in out_of_line(series)
    ]
    return _table(("robot", "size", "its mean", "mean of the others", "by chance"), rows, "No robot is out of line.")


def _changed(series: tuple[Series, ...]) -> str:
    rows = [
        (one.robot, one.quantity, one.since, f"{one.before:.3g}", f"{one.after:.3g} {one.unit}", f"{one.p:.1g}")
        for one in changes(series)
    ]
    return _table(("robot", "size", "since", "before", "after", "by chance"), rows, "No robot changed.")


def _table(head: tuple[str, ...], rows: list[tuple[str, ...]], none: str) -> str:
    if not rows:
        return f"<p>{none}</p>"
    cells = ["<tr>" + "".join(f"<th>{escape(word)}</th>" for word in head) + "</tr>"]
    cells += ["<tr>" + "".join(f"<td>{escape(word)}</td>" for word in row) + "</tr>" for row in rows]
    return "<table>" + "".join(cells) + "</table>"


def _chart(series: list[Series], robots: list[str]) -> str:
    """Sizes with 95 % intervals over the number of the recording, one colour a robot."""
    low = min(float(np.min(one.values - 1.96 * one.stds)) for one in series)
    high = max(float(np.max(one.values + 1.96 * one.stds)) for one in series)
    low, high = (low, high) if high > low else (low - 1.0, high + 1.0)
    longest = max(len(one.values) for one in series)

    def across(k: int) -> float:
        return _EDGE + (k + 0.5) / longest * (_WIDTH - 2 * _EDGE)

    def up(value: float) -> float:
        return _HEIGHT - 20 - (value - low) / (high - low) * (_HEIGHT - 40)

    marks = [f'<text x="2" y="{up(v) + 4:.1f}" font-size="11">{v:.3g}</text>' for v in (low, high)]
    if low < 0 < high:
        marks.append(f'<line x1="{_EDGE}" x2="{_WIDTH - _EDGE}" y1="{up(0):.1f}" y2="{up(0):.1f}" stroke="#bbb"/>')
    for one in series:
        place = robots.index(one.robot)
        colour = _COLOURS[place % len(_COLOURS)]
        shift = 6 * (place - (len(robots) - 1) / 2) / max(len(robots), 1)
        points = [
            (across(k) + shift, value, 1.96 * std)
            for k, (value, std) in enumerate(zip(one.values, one.stds, strict=True))
        ]
        line = " ".join(f"{x:.1f},{up(value):.1f}" for x, value, _ in points)
        marks.append(f'<polyline points="{line}" fill="none" stroke="{colour}" stroke-opacity="0.4"/>')
        for (x, value, half), log in zip(points, one.logs, strict=True):
            bar = f'<line x1="{x:.1f}" x2="{x:.1f}" y1="{up(value - half):.1f}" y2="{up(value + half):.1f}"'
            marks.append(f'{bar} stroke="{colour}"/>')
            told = escape(f"{one.robot} {log}: {value:.4g}")
            marks.append(
                f'<circle cx="{x:.1f}" cy="{up(value):.1f}" r="3" fill="{colour}"><title>{told}</title></circle>'
            )
    legend = " ".join(
        f'<span style="color:{_COLOURS[k % len(_COLOURS)]}">&#9679; {escape(robot)}</span>'
        for k, robot in enumerate(robots)
    )
    return f'<svg viewBox="0 0 {_WIDTH:g} {_HEIGHT:g}" role="img">{"".join(marks)}</svg><p>{legend}</p>'
