"""Draws the figures of the report as inline SVG, and prepares the samples of curves that can be zoomed.

Text and axes have the text colour of the page, so that they are also visible on dark pages.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from identification.diagnosis.evidence import Evidence
from identification.diagnosis.result import Diagnosis
from identification.reporting.charts.chart import AFTER, BEFORE, SECTION_S, Panel, chart, curve_over_time
from identification.reporting.charts.chart_marks import INK, Cloud, Curve
from identification.reporting.charts.thinning import (
    binned_median,
    gap_starts,
    largest_residual_section,
    scatter_choice,
    thinned,
)
from identification.reporting.page.explaining import (
    JointMotion,
    Variable,
    explaining_variable,
    joint_of,
    strongest_variable,
)
from identification.reporting.page.robot_scene import packed
from phantom_dyn.array_types import Array, Bool, Float, Int

BEFORE_POINTS, AFTER_POINTS = "#eba36f", "#6fb1d8"
# Groups of samples for which a median is drawn, each with the dashes of its line.
Groups = tuple[tuple[Bool[Array, " N"], str], ...]

_WINDOWS = 12  # largest number of windows of simulated motion that are shown at first
_SWINGS = 6  # largest number of swings of a leg that are shown at first, with the stances between them
FEW_POINTS = 600  # up to this number of points, the points of a cloud are drawn larger
FINER_FROM = 3.0  # the panels have different scales if the residuals differ by more than this factor


def torque_figure(diagnosis: Diagnosis, joint: int) -> str:
    """Draws measured and modelled torque over a section with a large residual, and the residuals below."""
    evidence, gap = diagnosis.evidence, diagnosis.joints[joint]
    rows = shown_section(evidence, joint)
    t = evidence.t[rows]

    tau = (
        curve_over_time(t, evidence.tau_measured[rows, joint], INK, 1.8, "measured", 0.55),
        curve_over_time(t, evidence.tau_before[rows, joint], BEFORE, 1.1, "given model"),
        curve_over_time(t, evidence.tau_after[rows, joint], AFTER, 1.1, "corrected model"),
    )
    residuals = [
        curve_over_time(t, residual(values, evidence, joint)[rows], colour, 0.9)
        for values, colour in ((evidence.tau_before, BEFORE), (evidence.tau_after, AFTER))
    ]
    top = Panel(torque_label(diagnosis, joint), tau, height=3.0)
    bottom = Panel(f"residual [{gap.unit}]", tuple(residuals), height=2.0, band=2 * gap.noise_floor, zero=True)
    title = f"Measured and modelled torque of joint {gap.joint} over time"
    return chart((top, bottom), "time [s]", (11.5, 4.2), title)


def position_figure(diagnosis: Diagnosis, joint: int) -> str:
    """Draws the measured position, the positions that both models simulate from recorded states, and their errors."""
    evidence, simulated = diagnosis.evidence, diagnosis.evidence.simulated
    if simulated is None:
        return ""
    rows = shown_motion(evidence, joint)
    t, read, given, corrected = (
        x[rows] for x in (evidence.t, evidence.q[:, joint], simulated.before[:, joint], simulated.after[:, joint])
    )
    positions = (
        curve_over_time(t, read, INK, 1.8, "measured", 0.55),
        curve_over_time(t, given, BEFORE, 1.3, "given model"),
        curve_over_time(t, corrected, AFTER, 1.3, "corrected model"),
    )
    errors = tuple(curve_over_time(t, read - q, colour, 1.1) for q, colour in ((given, BEFORE), (corrected, AFTER)))
    name, unit = diagnosis.joints[joint].joint, position_unit(diagnosis, joint)
    top = Panel(f"position [{unit}]", positions, height=3.0)
    bottom = Panel(f"error [{unit}]", errors, height=2.0, zero=True)
    return chart((top, bottom), "time [s]", (11.5, 4.2), f"Measured and simulated position of joint {name} over time")


def shown_motion(evidence: Evidence, joint: int) -> slice:
    """Samples of the section shown at first: the one with the largest position error of the given model.

    The section is at most ten seconds or a dozen windows long, whichever is shorter.
    """
    simulated = evidence.simulated
    if simulated is None:
        return slice(0, len(evidence.t))
    error = evidence.q[:, joint] - simulated.before[:, joint]
    windows = _WINDOWS if evidence.touched is None else _SWINGS
    return largest_residual_section(evidence.t, error, min(SECTION_S, windows * simulated.seconds))


def position_unit(diagnosis: Diagnosis, joint: int) -> str:
    """Unit of a joint's position."""
    return "m" if diagnosis.joints[joint].unit == "N" else "rad"


def shown_section(evidence: Evidence, joint: int) -> slice:
    """Samples of the section shown at first: the ten seconds with the largest residual of the given model."""
    return largest_residual_section(evidence.t, residual(evidence.tau_before, evidence, joint), SECTION_S)


def torque_label(diagnosis: Diagnosis, joint: int) -> str:
    """Label of the torque axis: torque, force for a linear joint, or position error if the joint is judged at rest."""
    unit = diagnosis.joints[joint].unit
    return f"{'error' if diagnosis.at_rest else 'force' if unit == 'N' else 'torque'} [{unit}]"


def residual_over_velocity(diagnosis: Diagnosis, joint: int) -> str:
    """Draws the residual over the joint's velocity, with the given model above and the corrected model below."""
    unit = "m/s" if diagnosis.joints[joint].unit == "N" else "rad/s"
    return _before_after(diagnosis, joint, Variable("velocity", unit, diagnosis.evidence.v[:, joint]))


def residual_over_position(diagnosis: Diagnosis, joint: int) -> str:
    """Draws the residual over the joint's position, with the given model above and the corrected model below.

    Each direction of motion has its own median, because friction causes two branches.
    """
    unit = position_unit(diagnosis, joint)
    q = diagnosis.evidence.q[:, joint]
    return _before_after(diagnosis, joint, Variable("position", unit, q, by_direction=True))


def finding_figure(diagnosis: Diagnosis, motions: dict[str, JointMotion], index: int) -> str:
    """Draws the residual over the variable that explains a finding: above without the finding, below with all findings.

    If the diagnosis has no fit without the finding, the upper residual is that of the given model.
    """
    evidence, finding = diagnosis.evidence, diagnosis.findings[index]
    row = joint_of(diagnosis, finding.joint)
    has_fits_without = bool(evidence.tau_without)
    before = residual(evidence.tau_without[index] if has_fits_without else evidence.tau_before, evidence, row)
    variable = explaining_variable(diagnosis, motions, finding, before)
    titles = ("without this finding", "with it") if has_fits_without else ("given model", "corrected model")
    after = residual(evidence.tau_after, evidence, row)
    return _residual_figure(diagnosis, row, variable, (before, after), titles)


def unexplained_figure(diagnosis: Diagnosis, motions: dict[str, JointMotion], joint: str) -> str:
    """Draws the residual that no effect of the catalogue explains, over the variable that explains most of it."""
    evidence, row = diagnosis.evidence, joint_of(diagnosis, joint)
    after = residual(evidence.tau_after, evidence, row)
    variable = strongest_variable(diagnosis, motions, diagnosis.joints[row].joint, after)
    return _before_after(diagnosis, row, variable)


def residual(tau: Float[Array, "N nv"], evidence: Evidence, joint: int) -> Float[Array, " N"]:
    """Measured minus modelled torque of one joint, shape ``(N,)``; NaN for samples that are not used."""
    return evidence.residual(tau)[:, joint]


def _before_after(diagnosis: Diagnosis, joint: int, variable: Variable) -> str:
    """Draws the residuals of the given and of the corrected model over a variable."""
    evidence = diagnosis.evidence
    both = (residual(evidence.tau_before, evidence, joint), residual(evidence.tau_after, evidence, joint))
    return _residual_figure(diagnosis, joint, variable, both, ("given model", "corrected model"))


def _residual_figure(
    diagnosis: Diagnosis,
    joint: int,
    variable: Variable,
    residuals: tuple[Float[Array, " N"], Float[Array, " N"]],
    titles: tuple[str, str],
) -> str:
    """Draws two residuals of a joint over a variable, one above the other, with medians."""
    gap, v = diagnosis.joints[joint], diagnosis.evidence.v[:, joint]
    within = np.isfinite(variable.x)
    if variable.reach:
        within &= np.abs(variable.x) <= variable.reach
    groups: Groups = ((v > 0, ""), (v < 0, "5.4 2.7")) if variable.by_direction else ((within, ""),)
    reach = [max(_largest_size(values[within]), 3 * np.nan_to_num(gap.noise_floor)) for values in residuals]
    # On the scale of a large gap, the residual of the corrected model would look like a flat line.
    finer = reach[0] > FINER_FROM * reach[1]

    colours = ((BEFORE_POINTS, BEFORE), (AFTER_POINTS, AFTER))
    named = (titles[0], f"{titles[1]}, finer scale" if finer else titles[1])
    panels = [
        Panel(
            f"residual [{gap.unit}]",
            _medians(np.where(within, variable.x, np.nan), values, groups, line),
            _cloud(np.where(within, variable.x, np.nan), values, points),
            title=f"{words}: samples and median",
            band=2 * gap.noise_floor,
            zero=True,
        )
        for values, (points, line), words in zip(residuals, colours, named, strict=True)
    ]
    title = f"Residual of joint {gap.joint} over {variable.name}"
    return chart(tuple(panels), f"{variable.name} [{variable.unit}]", (5.7, 4.2), title, same_scale=not finer)


def _cloud(x: Array, y: Array, colour: str) -> Cloud:
    """A cloud of some of the points, with larger points if there are few."""
    chosen = scatter_choice(np.isfinite(x) & np.isfinite(y))
    return Cloud(x[chosen], y[chosen], colour, 1.8 if len(chosen) > FEW_POINTS else 3.0)


def _medians(x: Array, y: Array, groups: Groups, colour: str) -> tuple[Curve, ...]:
    """Curves of the binned median of each group of samples."""
    finite = np.isfinite(x) & np.isfinite(y)
    inside = [(finite & members, dashes) for members, dashes in groups]
    return tuple(Curve(*binned_median(x[rows], y[rows]), colour, 1.8, dashes=dashes) for rows, dashes in inside)


def _largest_size(residual: Float[Array, " N"]) -> float:
    """Largest absolute value of a residual."""
    finite = residual[np.isfinite(residual)]
    return float(np.max(np.abs(finite))) if len(finite) else 0.0


SAMPLES = 30_000
"""Number of samples of all joints together. Each takes ten bytes, so that the page stays small."""
_MOST_OF_A_JOINT = 6_000
"""Largest number of samples of one joint: several times the pixels in a row of a screen."""
_STEPS = 32_767
"""A curve is rounded to its largest value divided by this number: finer than a screen shows, even after zooming in."""


def time_curves(diagnosis: Diagnosis, joints: Sequence[int]) -> str:
    """Measured torque and the residuals of both models over time, as JSON for ``curve_viewer.js``.

    If motion was simulated, entries with positions come first. Entries of legs include the times of stance.

    Args:
        diagnosis: The diagnosis, with its samples.
        joints: Indices of the joints.

    Returns:
        A list with one entry per figure: identifier on the page, axis labels, noise band, the section that is shown at
        first, and the curves as little-endian numbers in base64.
    """
    most = min(_MOST_OF_A_JOINT, SAMPLES // max(len(joints), 1))
    positions = (
        [] if diagnosis.evidence.simulated is None else [_position_curves(diagnosis, joint, most) for joint in joints]
    )
    return json.dumps([*positions, *(_curves(diagnosis, joint, most) for joint in joints)])


def _position_curves(diagnosis: Diagnosis, joint: int, most: int) -> dict[str, Any]:
    """Entry with a joint's measured position and the position errors of both models in simulation.

    Only windows are simulated, so the curves of the errors have gaps between windows.
    """
    evidence, simulated = diagnosis.evidence, diagnosis.evidence.simulated
    assert simulated is not None
    before, after = (evidence.q[:, joint] - q[:, joint] for q in (simulated.before, simulated.after))
    rows = _kept_rows((evidence.q[:, joint],), (before, after), most)
    stretch, unit = evidence.t[shown_motion(evidence, joint)], position_unit(diagnosis, joint)
    labels = {"id": f"positions-{joint}", "torque": f"position [{unit}]", "residual": f"error [{unit}]", "unit": unit}
    return {**labels, "floor": 0, **_numbers(evidence.t, stretch, rows, (evidence.q[:, joint], before, after))}


def _curves(diagnosis: Diagnosis, joint: int, most: int) -> dict[str, Any]:
    """Entry with a joint's measured torque and the residuals of both models."""
    evidence, gap = diagnosis.evidence, diagnosis.joints[joint]
    before, after = (residual(tau, evidence, joint) for tau in (evidence.tau_before, evidence.tau_after))
    measured = np.where(np.isfinite(before), evidence.tau_measured[:, joint], np.nan)
    rows = _kept_rows((measured, before, after), (), most)
    # At rest there are only a few samples, with large time steps, so all of them are shown.
    stretch = evidence.t if diagnosis.at_rest else evidence.t[shown_section(evidence, joint)]
    labels = {"id": f"curves-{joint}", "torque": torque_label(diagnosis, joint), "residual": f"residual [{gap.unit}]"}
    floor = 2 * gap.noise_floor if np.isfinite(gap.noise_floor) else 0
    numbers = _numbers(evidence.t, stretch, rows, (measured, before, after))
    return {**labels, "unit": gap.unit, "floor": floor, "touched": _stance_times(evidence, joint), **numbers}


def _stance_times(evidence: Evidence, joint: int) -> list[list[float]]:
    """First and last time of each stance phase, in which the leg's joint is not judged."""
    if evidence.touched is None:
        return []
    t, stance = evidence.t, evidence.touched[:, joint]
    edges = np.flatnonzero(np.diff(np.concatenate([[False], stance, [False]])))
    return np.round(np.column_stack([t[edges[::2]], t[edges[1::2] - 1]]), 4).tolist()


def _numbers(
    t: Float[Array, " N"], stretch: Float[Array, " s"], rows: Int[Array, " n"], curves: tuple[Array, Array, Array]
) -> dict[str, Any]:
    """Numbers of an entry: kept samples of a measured curve and of two errors, and the section shown at first."""
    view, names = [float(stretch[0]), float(stretch[-1])], ("measured", "before", "after")
    scaled_curves = {name: _scaled(curve[rows]) for name, curve in zip(names, curves, strict=True)}
    return {"view": view, "t": packed(t[rows], "<f4"), "starts": _curve_starts(t, rows, curves[0]), **scaled_curves}


def _kept_rows(whole: tuple[Array, ...], parts: tuple[Array, ...], most: int) -> Int[Array, " n"]:
    """Indices of about ``most`` samples, with the extremes of every curve and the ends of curves with gaps.

    Args:
        whole: Curves without gaps; samples at which one of them is not finite are left out.
        parts: Curves that may have gaps.
        most: Approximate number of samples.
    """
    finite = np.flatnonzero(np.isfinite(np.column_stack(whole)).all(axis=1))
    if len(finite) <= most:
        return finite
    curves = (*whole, *parts)
    chosen = [thinned(curve[finite], most // len(curves)) for curve in curves]
    finite_parts = [np.isfinite(part[finite]).astype(int) for part in parts]
    ends = [np.flatnonzero(np.diff(one))[:, None] + np.array([0, 1]) for one in finite_parts]
    within = [np.flatnonzero(one) for one in finite_parts]
    # If a curve has only few finite samples (a few short swings), all of them are kept.
    ends += [one for one in within if len(one) <= most // len(curves)]
    return finite[np.unique(np.concatenate([*chosen, *(one.ravel() for one in ends)]))]


def _curve_starts(t: Float[Array, " N"], rows: Int[Array, " n"], measured: Float[Array, " N"]) -> list[int]:
    """Indices of the kept samples that follow a gap.

    Gaps are detected in all samples, because kept samples are unevenly spaced.
    """
    known = np.isfinite(measured)
    begins = [gap_starts(t), np.flatnonzero(known[1:] & ~known[:-1]) + 1]
    return np.unique(np.searchsorted(rows, np.concatenate(begins))).tolist()


def _scaled(values: Float[Array, " n"]) -> dict[str, Any]:
    """A curve as 16-bit integers and the size of one step; the lowest integer marks a missing value."""
    known = np.isfinite(values)
    step = float(np.abs(values[known]).max(initial=0.0)) / _STEPS or 1.0
    return {"step": step, "values": packed(np.where(known, np.round(values / step), -_STEPS - 1), "<i2")}
