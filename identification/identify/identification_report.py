"""Builds the report on an identification: one self-contained HTML page with figures as inline SVG."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from identification.identify import identification_words as words
from identification.identify.identification import IdentifiedModel, JointError, Parameter
from identification.identify.identification_words import error_percent
from identification.reporting.charts.chart import AFTER, BEFORE, SECTION_S, Panel, chart, curve_over_time, short_name
from identification.reporting.charts.chart_marks import INK, Curve
from identification.reporting.charts.thinning import largest_residual_section
from phantom_dyn.array_types import Array, Float
from phantom_dyn.model.inertia import STANDARD_NAMES

_DECADES = 5  # number of decades of a spectrum that are drawn
_PER_OCTAVE = 12  # bins of a spectrum per octave

_FIGURES = 12  # largest number of joints with figures, beginning with the largest error
_OPEN = 2  # number of joints whose figures are unfolded at first


def error_bars(joints: tuple[JointError, ...]) -> str:
    """Figure of the relative torque errors of given and identified model on held-out samples, for each joint."""
    places = np.arange(len(joints), dtype=float)
    curves = [
        Curve(places, 100 * np.array(errors), colour, 0.0, label, marked=True, tips=tuple(map(error_percent, errors)))
        for errors, colour, label in (
            ([joint.given for joint in joints], BEFORE, "given model"),
            ([joint.relative for joint in joints], AFTER, "identified model"),
        )
    ]
    panel = Panel("error [% of the torque, RMS]", tuple(curves), least=(0.0,))
    names = tuple(short_name(joint.joint) for joint in joints)
    title = "Relative torque error of each joint on held-out data"
    return chart((panel,), "joint", (6.4, 2.8), title, x_names=names)


def torque_figure(found: IdentifiedModel, joint: int) -> str:
    """Figure of measured and predicted torque over a part of the held-out data, with the residual below."""
    evidence, error = found.evidence, found.joints[joint]
    measured, predicted = evidence.measured[:, joint], evidence.predicted[:, joint]
    rows = largest_residual_section(evidence.t, measured - predicted, SECTION_S)
    t = evidence.t[rows]
    torques = (
        curve_over_time(t, measured[rows], INK, 1.8, "measured", 0.55),
        curve_over_time(t, evidence.given[rows, joint], BEFORE, 0.9, "given model", 0.7),
        curve_over_time(t, predicted[rows], AFTER, 1.2, "identified model"),
    )
    top = Panel(f"torque [{error.unit}]" if error.unit != "N" else "force [N]", torques, height=3.0)
    residual = curve_over_time(t, (measured - predicted)[rows], AFTER, 0.9)
    bottom = Panel(f"residual [{error.unit}]", (residual,), height=2.0, zero=True)
    title = f"Measured and predicted torque of joint {error.joint} on held-out data"
    return chart((top, bottom), "time [s]", (7.2, 3.9), title)


def spectrum_figure(found: IdentifiedModel, joint: int) -> str:
    """Figure of the amplitude densities of measured torque and residual, with the edge of the band of the fit."""
    evidence, error = found.evidence, found.joints[joint]
    densities = (
        (evidence.measured_density[:, joint], INK, "torque"),
        (evidence.residual_density[:, joint], AFTER, "residual"),
    )
    top = max(float(np.nanmax(density)) for density, _, _ in densities) or 1.0
    least = top * 10.0**-_DECADES  # smaller values are rounding errors
    curves = []
    for density, colour, label in densities:
        x, y = _octave_bins(evidence.frequency, density)
        curves.append(Curve(x, np.where(y > least, y, np.nan), colour, 1.4, label, 0.8))
    end = np.full(2, found.band_hz[1])
    curves.append(Curve(end, np.array([least, top]), INK, 1.0, "band edge", dashes="4 2"))
    panel = Panel(f"amplitude density [{error.unit}/√Hz]", tuple(curves))
    title = f"Spectra of joint {error.joint}: torque and residual"
    return chart((panel,), "frequency [Hz]", (4.8, 3.9), title, logarithmic=True)


def _octave_bins(f: Float[Array, " F"], density: Float[Array, " F"]) -> tuple[Array, Array]:
    """Frequencies and densities, averaged (in power) over bins of equal width in octaves, to draw fewer points."""
    if not len(f):
        return f, density
    which = np.floor(np.log2(f / f[0]) * _PER_OCTAVE + 1e-9).astype(int)
    bins = np.unique(which)
    power = [np.sqrt(np.mean(density[which == k] ** 2)) for k in bins]
    return np.array([f[which == k].mean() for k in bins]), np.array(power)


@dataclass(frozen=True)
class JointView:
    """Name, error and figures of one joint, as the page shows them."""

    name: str
    error: str
    torque: Markup
    spectrum: Markup
    unfolded: bool


def report_html(found: IdentifiedModel) -> str:
    """The whole page as HTML text, which needs no other files."""
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    source = Path(__file__).with_name("identification_report.html.jinja").read_text(encoding="utf-8")
    return environment.from_string(source).render(
        found=found,
        headline=words.headline(found),
        errors=words.error_cells(found),
        error_figure=Markup(error_bars(found.joints)),
        joints=_joint_views(found),
        links=[_row(parameter) for parameter in found.base],
        others=[
            (parameter.joint or "all", words.law_cell(parameter, found.others), *_row(parameter)[1:])
            for parameter in found.others
        ],
        columns=STANDARD_NAMES,
        shares=words.IDENTIFIABILITY,
        exports=[
            (export, words.export_sentence(export.difference, export.tolerance, export.loaded_with))
            for export in found.exports
        ],
        band=f"0 to {found.band_hz[1]:.3g} Hz",
        condition=f"{found.condition:.3g}",
        seconds=f"{found.seconds:.1f}",
    )


def _row(parameter: Parameter) -> tuple[str, str, str, bool, str, str]:
    """Cells of a table: name, value, relative deviation, True if identified, reason if not, regrouped combination."""
    return (
        parameter.name,
        words.value_cell(parameter),
        words.relative_cell(parameter),
        parameter.identified,
        parameter.why,
        parameter.regroups,
    )


def _joint_views(found: IdentifiedModel) -> list[JointView]:
    """The joints with figures, in the order of the robot; the figures of the largest errors are unfolded."""
    if len(found.evidence.t) < 2:
        return []
    errors = np.nan_to_num([joint.relative for joint in found.joints])
    ranked = np.argsort(-errors, kind="stable").tolist()
    drawn = set(ranked[:_FIGURES])
    return [
        JointView(
            joint.joint,
            words.error_percent(joint.relative),
            Markup(torque_figure(found, k)),
            Markup(spectrum_figure(found, k) if len(found.evidence.frequency) else ""),
            k in ranked[:_OPEN],
        )
        for k, joint in enumerate(found.joints)
        if k in drawn
    ]
