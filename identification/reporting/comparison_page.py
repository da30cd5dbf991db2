"""Writes an HTML page that compares diagnoses: a table, and a figure of each parameter with its 95 % intervals."""

from __future__ import annotations

import numpy as np

from identification.diagnosis.result import Value
from identification.reporting.charts.chart import AFTER, BEFORE, Panel, chart, short_name
from identification.reporting.charts.chart_marks import Curve
from identification.reporting.comparison import (
    INTERVAL,
    ComparedFinding,
    ComparedSize,
    Comparison,
    first_lines,
    value_with_interval,
)
from identification.reporting.plain_page import figure, page, table
from identification.words.diagnosis_words import capital, joined, parameter_name, placed_effect
from identification.words.numbers_and_names import NO_BREAK, number

_SIZE = (4.6, 2.3)  # size of a figure [inch]
_LETTERS = 42  # number of letters that fit below the axis of a figure
_WIDE = 9.4  # width of the figure of all joints [inch]
_CHANGED = {True: "changed", False: "the same", None: ""}


def comparison_page(found: Comparison) -> str:
    """The page as self-contained HTML."""
    parts = [f"<p>{' '.join(map(_plain, first_lines(found)))}</p>"]
    if found.findings:
        parts.append(_findings_table(found))
        figures = [_size_figure(found, row, size) for row in found.findings for size in row.sizes]
        parts += [
            "<h2>Sizes</h2>",
            "<p>Points are estimates, bars 95 % intervals. Orange sizes changed by more than chance explains. A grey "
            "bar marks a diagnosis without the finding: it reaches up to the smallest size that this diagnosis would "
            "have detected.</p>",
            f'<div class="figures">{"".join(figures)}</div>',
        ]
    parts += [
        "<h2>Residuals</h2>",
        "<p>Root mean square of measured minus modelled torque on held-out samples (at rest: of the position).</p>",
        *_residual_figures(found),
    ]
    return page(f"What changed: {joined(list(found.names))}", parts)


def _findings_table(found: Comparison) -> str:
    rows = []
    for row in found.findings:
        name = capital(placed_effect(row.at))
        for size in row.sizes:
            pairs = zip(size.values, row.missing, strict=True)
            cells = [value_with_interval(value) or statement for value, statement in pairs]
            verdict = _CHANGED[any(row.missing) or size.changed]
            rows.append((f"{name}, {parameter_name(size.parameter)}", *map(_plain, cells), verdict))
        if not row.sizes:
            pairs = zip(row.findings, row.missing, strict=True)
            cells = ["found" if finding else statement for finding, statement in pairs]
            rows.append((name, *map(_plain, cells), _CHANGED[any(row.missing)]))
    return table(("finding", *found.names, ""), rows)


def _size_figure(found: Comparison, row: ComparedFinding, size: ComparedSize) -> str:
    """Figure of one parameter in all diagnoses, with one curve for each number of the parameter."""
    place = (row.at.effect, row.at.joint, size.parameter)
    unit = next(value.unit for value in size.values if value is not None)
    changed = size.changed or any(row.missing)
    entries = max(len(value.numbers) for value in size.values if value is not None)
    curves = tuple(_entry_curve(size, k, BEFORE if changed else AFTER) for k in range(entries))
    title = f"{capital(placed_effect(row.at))}, {parameter_name(size.parameter)}"
    label = f"{short_name(parameter_name(size.parameter))} [{unit}]"
    hidden = [
        next((b.below for b in diagnosis.bounds if (b.effect, b.joint, b.parameter) == place), 0.0) if missing else 0.0
        for diagnosis, missing in zip(found.diagnoses, row.missing, strict=True)
    ]
    notes = [f"{name}: {statement}" for name, statement in zip(found.names, row.missing, strict=True) if statement]
    panel = Panel(label, (_hidden_curve(hidden), *curves), least=(0.0,), zero=True)
    svg = chart(
        (panel,),
        "diagnosis",
        _SIZE,
        title,
        x_names=tuple(short_name(name, max(8, _LETTERS // len(found.names))) for name in found.names),
    )
    return figure(title, svg, [_plain(note) for note in notes])


def _hidden_curve(below: list[float]) -> Curve:
    """Grey bars from zero to the smallest detectable size, for diagnoses without the finding."""
    half = 0.5 * np.array(below)
    return Curve(np.arange(len(half)), np.where(half > 0, half, np.nan), "#808080", 0.0, half=half)


def _entry_curve(size: ComparedSize, entry: int, colour: str) -> Curve:
    """Curve of one number of a parameter in all diagnoses; points with unknown standard deviation have no bar."""
    pairs = [_entry(value, entry) for value in size.values]
    y, std = np.array(pairs, dtype=float).T
    half = INTERVAL * np.where(np.isfinite(std), std, 0.0)
    tips = tuple("" if value is None else _plain(value_with_interval(value)) for value in size.values)
    return Curve(np.arange(len(y)), y, colour, 1.0, opacity=0.5, marked=True, half=half, tips=tips)


def _entry(value: Value | None, entry: int) -> tuple[float, float]:
    """One number of a value and its standard deviation; NaN if missing."""
    if value is None or entry >= len(value.numbers):
        return float("nan"), float("nan")
    return float(value.numbers[entry]), float(value.stds[entry])


def _residual_figures(found: Comparison) -> list[str]:
    """Figures of the residuals of all joints: one figure per unit, with a panel for each diagnosis."""
    joints = found.diagnoses[0].joints
    return [
        _residual_figure(found, unit, [k for k, gap in enumerate(joints) if gap.unit == unit])
        for unit in dict.fromkeys(gap.unit for gap in joints)
    ]


def _residual_figure(found: Comparison, unit: str, rows: list[int]) -> str:
    names = tuple(short_name(found.diagnoses[0].joints[k].joint, 14) for k in rows)
    panels = []
    for name, diagnosis in zip(found.names, found.diagnoses, strict=True):
        gaps = [diagnosis.joints[k] for k in rows]
        levels = (
            ("given model", BEFORE, [gap.rms_before for gap in gaps]),
            ("corrected model", AFTER, [gap.rms_after for gap in gaps]),
        )
        curves = tuple(_marks(values, colour, label, unit) for label, colour, values in levels)
        panels.append(Panel(f"[{unit}]", curves, title=short_name(name, 40), least=(0.0,)))
    legend = f"Orange: given model. Blue: corrected model. {unit}, one panel per diagnosis."
    size = (_WIDE if len(rows) > 3 else _SIZE[0], 0.7 + 1.2 * len(panels))
    return figure("", chart(tuple(panels), "joint", size, "Residuals of each joint", same_scale=True, x_names=names),
                  [legend])  # fmt: skip


def _marks(values: list[float], colour: str, label: str, unit: str) -> Curve:
    tips = tuple(f"{label}: {number(value)} {unit}" for value in values)
    return Curve(np.arange(len(values)), np.array(values), colour, 0.0, marked=True, tips=tips)


def _plain(words: str) -> str:
    return words.replace(NO_BREAK, " ")
