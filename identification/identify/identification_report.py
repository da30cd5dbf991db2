"""The report on an identification: one self-contained page with its figures as inline SVG."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jinja2 import Environment, StrictUndefined
from markupsafe import Markup
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter

from identification.identify import identification_words as words
from identification.identify.identification import IdentifiedModel, JointError, Parameter
from identification.identify.identification_words import error_percent
from identification.reporting.charts.chart import AFTER, BEFORE, STRETCH_S, short_name
from identification.reporting.charts.svg import INK, draw_curve, draw_legend, drawn_svg
from identification.reporting.charts.thinning import eventful_stretch
from phantom_dyn.array_types import Array, Float
from phantom_dyn.model.inertia import STANDARD_NAMES

_DECADES = 5  # of a spectrum
_PER_OCTAVE = 12  # bins of a spectrum

_FIGURES = 12  # joints whose torques are drawn, those with the largest error first
_OPEN = 2  # so many of them are unfolded


def error_bars(joints: tuple[JointError, ...]) -> str:
    """Relative torque error of every joint on held-out samples, given model and identified model."""

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        rows = np.arange(len(joints), dtype=float)
        for shift, values, colour, label in (
            (-0.19, [100 * joint.given for joint in joints], BEFORE, "given model"),
            (0.19, [100 * joint.relative for joint in joints], AFTER, "identified model"),
        ):
            bars = axes.barh(rows + shift, np.nan_to_num(values), height=0.36, color=colour, label=label)
            words = [error_percent(value / 100) for value in values]
            axes.bar_label(bars, words, padding=3, fontsize=9.5)
        axes.set_yticks(rows, [short_name(joint.joint) for joint in joints])
        axes.invert_yaxis()
        axes.margins(x=0.14)
        axes.set_xlim(left=0.0)
        axes.set_xlabel("torque error on held-out data [% of the measured torque, RMS]")
        draw_legend(figure, axes)

    size = (6.4, 1.0 + 0.5 * len(joints))
    return drawn_svg(draw, "errors", size, "Relative torque error of each joint on held-out data")


def torque_figure(found: IdentifiedModel, joint: int) -> str:
    """Measured and predicted torque over a stretch of held-out data, residual below."""
    evidence, error = found.evidence, found.joints[joint]
    measured, predicted = evidence.measured[:, joint], evidence.predicted[:, joint]
    rows = eventful_stretch(evidence.t, measured - predicted, STRETCH_S)
    t = evidence.t[rows]

    def draw(figure: Figure) -> None:
        top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
        draw_curve(top, t, measured[rows], INK, "measured", 1.8, 0.55)
        draw_curve(top, t, evidence.given[rows, joint], BEFORE, "given model", 0.9, 0.7)
        draw_curve(top, t, predicted[rows], AFTER, "identified model", 1.2)
        draw_curve(bottom, t, (measured - predicted)[rows], AFTER, "", 0.9)
        bottom.axhline(0.0, color=INK, linewidth=0.5, alpha=0.6)
        top.set_ylabel(f"torque [{error.unit}]" if error.unit != "N" else "force [N]")
        bottom.set_ylabel(f"residual [{error.unit}]")
        bottom.set_xlabel("time [s]")
        draw_legend(figure, top)
        figure.align_ylabels()

    title = f"Measured and predicted torque of joint {error.joint} on held-out data"
    return drawn_svg(draw, f"torque{joint}", (7.2, 3.9), title)


def spectrum_figure(found: IdentifiedModel, joint: int) -> str:
    """Amplitude density of measured torque and of the residual, and where the band of the fit ends."""
    evidence, error = found.evidence, found.joints[joint]

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        for density, colour, label in (
            (evidence.measured_density, INK, "measured torque"),
            (evidence.residual_density, AFTER, "residual"),
        ):
            x, y = _octave_bins(evidence.frequency, density[:, joint])
            axes.plot(x, np.where(y > 0, y, np.nan), color=colour, linewidth=1.4, label=label, alpha=0.8)
        axes.axvline(found.band_hz[1], color=INK, linewidth=1.0, linestyle=(0, (4, 2)), label="end of the band")
        axes.set_xscale("log")
        axes.set_yscale("log")
        # What lies far below the rest is rounding.
        top = float(np.nanmax([evidence.measured_density[:, joint], evidence.residual_density[:, joint]]))
        if top > 0:
            axes.set_ylim(top * 10**-_DECADES, 3 * top)
        for axis in (axes.xaxis, axes.yaxis):  # text is not parsed for powers of ten, see svg.STYLE
            axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            axis.set_minor_formatter(NullFormatter())
        axes.set_xlabel("frequency [Hz]")
        axes.set_ylabel(f"amplitude density [{error.unit}/√Hz]")
        draw_legend(figure, axes)

    return drawn_svg(draw, f"spectrum{joint}", (4.8, 3.9), f"Spectra of joint {error.joint}: torque and residual")


def _octave_bins(f: Float[Array, " F"], density: Float[Array, " F"]) -> tuple[Array, Array]:
    """Density averaged in power over bins of equal ratio: few lines where frequencies are dense."""
    if not len(f):
        return f, density
    which = np.floor(np.log2(f / f[0]) * _PER_OCTAVE + 1e-9).astype(int)
    bins = np.unique(which)
    power = [np.sqrt(np.mean(density[which == k] ** 2)) for k in bins]
    return np.array([f[which == k].mean() for k in bins]), np.array(power)


@dataclass(frozen=True)
class JointView:
    """One joint on the page: name, error, figures."""

    name: str
    error: str
    torque: Markup
    spectrum: Markup
    unfolded: bool


def report_html(found: IdentifiedModel) -> str:
    """The whole page as text; everything it shows is inside it, and every name is escaped."""
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
        shares=words.SHARES,
        exports=[
            (export, words.export_sentence(export.difference, export.tolerance, export.loaded_with))
            for export in found.exports
        ],
        band=f"0 to {found.band_hz[1]:.3g} Hz",
        condition=f"{found.condition:.3g}",
        seconds=f"{found.seconds:.1f}",
    )


def _row(parameter: Parameter) -> tuple[str, str, str, bool, str, str]:
    """Name, value, relative deviation, whether identified, why not, what it is the sum of."""
    return (
        parameter.name,
        words.value_cell(parameter),
        words.relative_cell(parameter),
        parameter.identified,
        parameter.why,
        parameter.regroups,
    )


def _joint_views(found: IdentifiedModel) -> list[JointView]:
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
