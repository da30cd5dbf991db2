"""The report on an identification: one self-contained page."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.resources import files

import numpy as np
from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from identification.identify import words
from identification.identify.figures import error_bars, spectrum_figure, torque_figure
from identification.identify.result import Identification, Parameter
from phantom_dyn.inertia import STANDARD_NAMES

_FIGURES = 12  # joints whose torques are drawn, those with the largest error first
_OPEN = 2  # so many of them are unfolded


@dataclass(frozen=True)
class JointView:
    """One joint on the page: name, error, figures."""

    name: str
    error: str
    torque: Markup
    spectrum: Markup
    unfolded: bool


def report_html(found: Identification) -> str:
    """The whole page as text; everything it shows is inside it, and every name is escaped."""
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    source = files("identification.identify").joinpath("report.html.jinja").read_text(encoding="utf-8")
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


def _joint_views(found: Identification) -> list[JointView]:
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
