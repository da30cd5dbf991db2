"""Prepares the report's section on measured poses: sentences, tables, and a chart of the errors of poses."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup

from identification.reporting.charts.chart import AFTER, BEFORE, Panel, chart
from identification.reporting.charts.chart_marks import Curve
from identification.words import geometry_words as words
from identification.words.diagnosis_words import certainty_words, finding_share

if TYPE_CHECKING:
    from identification.geometry.result import FrameGap, GeometryResult, PoseBound, PoseEvidence, PoseFinding

Row = tuple[str, ...]
_MOST_POSES = 400  # largest number of poses in a curve; more would only enlarge the page


def poses_view(found: GeometryResult) -> dict[str, Any]:
    """Values of the section, by their names in the template.

    ``findings`` contains effect, size, share, certainty and rivals of each finding; ``fitted`` the poses of base and
    targets that are not given and were fitted; ``bounds`` the sizes of effects that would have been found;
    ``not_testable`` the parameters that these poses do not determine, with the reason.
    """
    return {
        "sentences": words.geometry_sentences(found),
        "findings": [_finding(one) for one in (*found.findings, *found.minor)],
        "frames": [_frame(one) for one in found.frames],
        "fitted": [
            (
                "Robot in the axes of the measuring device" if one.what == "base" else f"Target on {one.frame}",
                one.file,
                ", ".join(f"{1e3 * x:.4g}" for x in one.pose[:3]),
                ", ".join(f"{1e3 * x:.4g}" for x in one.pose[3:]),
            )
            for one in found.fitted
        ],
        "bounds": [_bound(one) for one in found.bounds],
        "not_testable": _not_testable(found),
        "chart": Markup("" if found.evidence is None else _chart(found.evidence, found.frames)),
    }


def _finding(one: PoseFinding) -> Row:
    """Row of the table of findings."""
    rivals = "; ".join(words.joined([words.place_words(place) for place in rival.places]) for rival in one.rivals)
    return (
        f"{words.EFFECTS[one.effect]} of {words.place_of(one.effect, one.joint)}",
        words.finding_sizes(one),
        finding_share(one),
        certainty_words(one.probability),
        rivals or "nothing",
    )


def _frame(one: FrameGap) -> Row:
    """Row of the table of frames."""
    sizes = (one.rms_before, one.rms_after, one.noise_floor)
    return (one.frame, *(words.small_words(size, one.unit) for size in sizes), one.noise_floor_source.replace("_", " "))


def _bound(one: PoseBound) -> Row:
    """Row of the table of detection limits."""
    at = words.place_of(one.effect, one.joint)
    return (at, f"{one.effect} {one.parameter}", words.small_words(one.below, one.unit))


def _not_testable(found: GeometryResult) -> list[Row]:
    """Rows of the parameters that these poses do not determine, one for each reason."""
    names_by_reason: dict[str, list[str]] = {}
    for one in found.not_testable:
        names_by_reason.setdefault(one.why, []).append(
            f"{words.place_of(one.effect, one.joint)} {one.effect} {one.parameter}"
        )
    return [(", ".join(names), why) for why, names in names_by_reason.items()]


def _chart(evidence: PoseEvidence, frames: tuple[FrameGap, ...]) -> str:
    """Draws the errors of poses before and after correction, one panel per frame.

    The horizontal axis is time if all poses are of a motion, otherwise the index of the pose.
    """
    moving = bool(evidence.moving.all())
    panels = []
    for number, name in enumerate(evidence.frames):
        rows = np.flatnonzero(evidence.frame == number)
        rows = rows[np.linspace(0, len(rows) - 1, min(len(rows), _MOST_POSES)).astype(int)]
        x = evidence.t[rows] if moving else np.arange(1.0, len(rows) + 1)
        noise = max(frame.noise_floor for frame in frames if frame.frame == name and frame.unit == "m")
        curves = (
            Curve(x, 1e3 * evidence.before[rows], BEFORE, 1.2, "given", marked=not moving),
            Curve(x, 1e3 * evidence.after[rows], AFTER, 1.2, "corrected", marked=not moving),
        )
        panels.append(Panel(f"{name} [mm]", curves, rule=1e3 * noise, least=(0.0,)))
    label = "time [s]" if moving else "pose"
    size = (7.6, 1.4 + 1.3 * len(panels))
    return chart(tuple(panels), label, size, "Error of each measured pose, given and corrected; dashed: noise")
