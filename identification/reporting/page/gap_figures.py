"""The figures of the report as inline SVG, and the samples of its curves that the reader can zoom into.

Text and axes take the colour of the page, so that dark pages work too.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from identification.diagnosis.evidence import Evidence
from identification.diagnosis.result import Diagnosis
from identification.reporting.charts.chart import AFTER, BEFORE, STRETCH_S, Panel, chart
from identification.reporting.charts.chart_marks import INK, Cloud, Curve
from identification.reporting.charts.thinning import (
    binned_median,
    eventful_stretch,
    gap_starts,
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
from phantom_dyn.array_types import Array, Bool, Float, Int

BEFORE_POINTS, AFTER_POINTS = "#eba36f", "#6fb1d8"
# Samples of which a median is drawn, each with the dashes of its line.
Groups = tuple[tuple[Bool[Array, " N"], str], ...]

_WINDOWS = 12  # of simulated motion that are seen at first, where they are short: each has to be seen
_SWINGS = 6  # the same of swings of a leg, with what lies between them
FEW_POINTS = 600  # fewer are drawn larger
FINER_FROM = 3.0  # ratio of residuals from which the corrected model's panel has a scale of its own


def torque_figure(diagnosis: Diagnosis, joint: int) -> str:
    """Torque measured and modelled over a stretch that shows something, and the residuals below it."""
    evidence, gap = diagnosis.evidence, diagnosis.joints[joint]
    rows = shown_stretch(evidence, joint)
    t = evidence.t[rows]

    tau = (
        _over_time(t, evidence.tau_measured[rows, joint], INK, 1.8, "measured", 0.55),
        _over_time(t, evidence.tau_before[rows, joint], BEFORE, 1.1, "given model"),
        _over_time(t, evidence.tau_after[rows, joint], AFTER, 1.1, "corrected model"),
    )
    left = [
        _over_time(t, residual(values, evidence, joint)[rows], colour, 0.9)
        for values, colour in ((evidence.tau_before, BEFORE), (evidence.tau_after, AFTER))
    ]
    top = Panel(torque_label(diagnosis, joint), tau, height=3.0)
    bottom = Panel(f"residual [{gap.unit}]", tuple(left), height=2.0, band=2 * gap.noise_floor, zero=True)
    title = f"Measured and modelled torque of joint {gap.joint} over time"
    return chart((top, bottom), "time [s]", (11.5, 4.2), title)


def position_figure(diagnosis: Diagnosis, joint: int) -> str:
    """Position measured, and simulated by both models from recorded states, and the errors of these below it."""
    evidence, followed = diagnosis.evidence, diagnosis.evidence.followed
    if followed is None:
        return ""
    rows = shown_motion(evidence, joint)
    t, read, given, corrected = (
        x[rows] for x in (evidence.t, evidence.q[:, joint], followed.before[:, joint], followed.after[:, joint])
    )
    places = (
        _over_time(t, read, INK, 1.8, "measured", 0.55),
        _over_time(t, given, BEFORE, 1.3, "given model"),
        _over_time(t, corrected, AFTER, 1.3, "corrected model"),
    )
    left = tuple(_over_time(t, read - q, colour, 1.1) for q, colour in ((given, BEFORE), (corrected, AFTER)))
    name, unit = diagnosis.joints[joint].joint, position_unit(diagnosis, joint)
    top = Panel(f"position [{unit}]", places, height=3.0)
    bottom = Panel(f"error [{unit}]", left, height=2.0, zero=True)
    return chart((top, bottom), "time [s]", (11.5, 4.2), f"Measured and simulated position of joint {name} over time")


def shown_motion(evidence: Evidence, joint: int) -> slice:
    """Rows of the stretch that is seen first: ten seconds, or a dozen windows, where the given model errs most."""
    followed = evidence.followed
    if followed is None:
        return slice(0, len(evidence.t))
    error = evidence.q[:, joint] - followed.before[:, joint]
    windows = _WINDOWS if evidence.touched is None else _SWINGS
    return eventful_stretch(evidence.t, error, min(STRETCH_S, windows * followed.seconds))


def position_unit(diagnosis: Diagnosis, joint: int) -> str:
    """Unit of a joint's position."""
    return "m" if diagnosis.joints[joint].unit == "N" else "rad"


def shown_stretch(evidence: Evidence, joint: int) -> slice:
    """Rows of the stretch of ten seconds whose residual of the given model is largest: what is seen first."""
    return eventful_stretch(evidence.t, residual(evidence.tau_before, evidence, joint), STRETCH_S)


def torque_label(diagnosis: Diagnosis, joint: int) -> str:
    """Label of an axis over which torque is drawn, force of a linear joint, position where it is judged at rest."""
    unit = diagnosis.joints[joint].unit
    return f"{'error' if diagnosis.at_rest else 'force' if unit == 'N' else 'torque'} [{unit}]"


def residual_over_velocity(diagnosis: Diagnosis, joint: int) -> str:
    """Residual over the joint's own velocity, given model above, corrected model below."""
    unit = "m/s" if diagnosis.joints[joint].unit == "N" else "rad/s"
    return _before_after(diagnosis, joint, Variable("velocity", unit, diagnosis.evidence.v[:, joint]))


def residual_over_position(diagnosis: Diagnosis, joint: int) -> str:
    """Residual over the joint's own position, given model above, corrected model below, medians by direction.

    One median over both directions would jump between the two branches that friction makes.
    """
    unit = position_unit(diagnosis, joint)
    q = diagnosis.evidence.q[:, joint]
    return _before_after(diagnosis, joint, Variable("position", unit, q, by_direction=True))


def finding_figure(diagnosis: Diagnosis, motions: dict[str, JointMotion], index: int) -> str:
    """Residual over the variable that explains a finding: without it above, with everything that was found below."""
    evidence, finding = diagnosis.evidence, diagnosis.findings[index]
    row = joint_of(diagnosis, finding.joint)
    alone = bool(evidence.tau_without)
    before = residual(evidence.tau_without[index] if alone else evidence.tau_before, evidence, row)
    variable = explaining_variable(diagnosis, motions, finding, before)
    titles = ("without this finding", "with it") if alone else ("given model", "corrected model")
    after = residual(evidence.tau_after, evidence, row)
    return _residual_figure(diagnosis, row, variable, (before, after), titles)


def unexplained_figure(diagnosis: Diagnosis, motions: dict[str, JointMotion], joint: str) -> str:
    """Residual that no effect of the catalogue explains, over the variable that explains most of it."""
    evidence, row = diagnosis.evidence, joint_of(diagnosis, joint)
    after = residual(evidence.tau_after, evidence, row)
    variable = strongest_variable(diagnosis, motions, diagnosis.joints[row].joint, after)
    return _before_after(diagnosis, row, variable)


def residual(tau: Float[Array, "N nv"], evidence: Evidence, joint: int) -> Float[Array, " N"]:
    """Measured less modelled torque of one joint, NaN where its row is not used."""
    return evidence.residual(tau)[:, joint]


def _before_after(diagnosis: Diagnosis, joint: int, variable: Variable) -> str:
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
    gap, v = diagnosis.joints[joint], diagnosis.evidence.v[:, joint]
    within = np.isfinite(variable.x)
    if variable.reach:
        within &= np.abs(variable.x) <= variable.reach
    groups: Groups = ((v > 0, ""), (v < 0, "5.4 2.7")) if variable.by_direction else ((within, ""),)
    reach = [max(_reach(values[within]), 3 * np.nan_to_num(gap.noise_floor)) for values in residuals]
    # What is left would be a flat line on the scale of a large gap.
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


def _over_time(t: Array, y: Array, colour: str, width: float, label: str = "", opacity: float = 1.0) -> Curve:
    """A thinned curve over time; between recordings, and in their gaps, the line is interrupted."""
    # Before samples are left out: those that are kept are at uneven steps.
    begins = np.zeros(len(t), dtype=bool)
    begins[gap_starts(t)] = True
    # What has no number in between is two curves.
    begins[1:] |= np.isfinite(y[1:]) & ~np.isfinite(y[:-1])
    y = np.asarray(y, dtype=float)
    kept = np.flatnonzero(np.isfinite(y))
    chosen = kept[thinned(y[kept])]
    piece = np.cumsum(begins)[chosen]
    x, y = t[chosen], y[chosen]
    starts = np.flatnonzero(np.diff(piece)) + 1
    return Curve(np.insert(x, starts, np.nan), np.insert(y, starts, np.nan), colour, width, label, opacity)


def _cloud(x: Array, y: Array, colour: str) -> Cloud:
    chosen = scatter_choice(np.isfinite(x) & np.isfinite(y))
    return Cloud(x[chosen], y[chosen], colour, 1.8 if len(chosen) > FEW_POINTS else 3.0)


def _medians(x: Array, y: Array, groups: Groups, colour: str) -> tuple[Curve, ...]:
    finite = np.isfinite(x) & np.isfinite(y)
    inside = [(finite & members, dashes) for members, dashes in groups]
    return tuple(Curve(*binned_median(x[rows], y[rows]), colour, 1.8, dashes=dashes) for rows, dashes in inside)


def _reach(residual: Float[Array, " N"]) -> float:
    finite = residual[np.isfinite(residual)]
    return float(np.max(np.abs(finite))) if len(finite) else 0.0


SAMPLES = 30_000
"""Of all joints together: ten bytes each, so that the page stays small."""
_OF_ONE = 6_000
"""Samples of one joint at most: more than a screen has points, and several times over."""
_STEPS = 32_767
"""Steps of a curve from zero to its largest value: finer than a screen shows, even where it is looked at closer."""


def time_curves(diagnosis: Diagnosis, joints: Sequence[int]) -> str:
    """Torque that was measured and that both models leave, over time, as JSON for ``curve_viewer.js``.

    Of legs the times are with them in which they stand.

    Where motion was simulated, positions come first.

    Args:
        diagnosis: Holds the samples.
        joints: Which joints are shown.

    Returns:
        A list with one entry a joint: where on the page it is drawn, axis labels, noise band, the stretch that is shown
        at first, and the curves, little-endian numbers in base64.
    """
    most = min(_OF_ONE, SAMPLES // max(len(joints), 1))
    moved = [] if diagnosis.evidence.followed is None else [_moved(diagnosis, joint, most) for joint in joints]
    return json.dumps([*moved, *(_curves(diagnosis, joint, most) for joint in joints)])


def _moved(diagnosis: Diagnosis, joint: int, most: int) -> dict[str, Any]:
    """Position that was measured, and that both models reach in simulation; the stretch where the given one errs most.

    Nothing was simulated between windows: there the curves of the models have gaps.
    """
    evidence, followed = diagnosis.evidence, diagnosis.evidence.followed
    assert followed is not None
    before, after = (evidence.q[:, joint] - q[:, joint] for q in (followed.before, followed.after))
    rows = _kept((evidence.q[:, joint],), (before, after), most)
    stretch, unit = evidence.t[shown_motion(evidence, joint)], position_unit(diagnosis, joint)
    said = {"id": f"positions-{joint}", "torque": f"position [{unit}]", "residual": f"error [{unit}]", "unit": unit}
    return {**said, "floor": 0, **_numbers(evidence.t, stretch, rows, (evidence.q[:, joint], before, after))}


def _curves(diagnosis: Diagnosis, joint: int, most: int) -> dict[str, Any]:
    evidence, gap = diagnosis.evidence, diagnosis.joints[joint]
    before, after = (residual(tau, evidence, joint) for tau in (evidence.tau_before, evidence.tau_after))
    measured = np.where(np.isfinite(before), evidence.tau_measured[:, joint], np.nan)
    rows = _kept((measured, before, after), (), most)
    # At rest there are few samples, far apart.
    stretch = evidence.t if diagnosis.at_rest else evidence.t[shown_stretch(evidence, joint)]
    said = {"id": f"curves-{joint}", "torque": torque_label(diagnosis, joint), "residual": f"residual [{gap.unit}]"}
    floor = 2 * gap.noise_floor if np.isfinite(gap.noise_floor) else 0
    curves = measured, before, after
    numbers = _numbers(evidence.t, stretch, rows, curves)
    return {**said, "unit": gap.unit, "floor": floor, "touched": _stands(evidence, joint), **numbers}


def _stands(evidence: Evidence, joint: int) -> list[list[float]]:
    """First and last time of every stretch in which the row of a joint is not used, as its leg stands."""
    if evidence.touched is None:
        return []
    t, there = evidence.t, evidence.touched[:, joint]
    edges = np.flatnonzero(np.diff(np.concatenate([[False], there, [False]])))
    return np.round(np.column_stack([t[edges[::2]], t[edges[1::2] - 1]]), 4).tolist()


def _numbers(
    t: Float[Array, " N"], stretch: Float[Array, " s"], rows: Int[Array, " n"], curves: tuple[Array, Array, Array]
) -> dict[str, Any]:
    """The kept rows of a curve that was measured and of two errors, and the stretch that is shown first."""
    view, names = [float(stretch[0]), float(stretch[-1])], ("measured", "before", "after")
    kept = {name: _scaled(curve[rows]) for name, curve in zip(names, curves, strict=True)}
    return {"view": view, "t": _packed(t[rows], "<f4"), "starts": _starts(t, rows, curves[0]), **kept}


def _kept(whole: tuple[Array, ...], parts: tuple[Array, ...], most: int) -> Int[Array, " n"]:
    """Rows, at most ``most`` or a few more, with the extremes of every curve and the ends of those with gaps.

    Args:
        whole: Curves; rows where one of them has no number are left out.
        parts: Curves that may have gaps.
        most: How many rows.
    """
    finite = np.flatnonzero(np.isfinite(np.column_stack(whole)).all(axis=1))
    if len(finite) <= most:
        return finite
    curves = (*whole, *parts)
    chosen = [thinned(curve[finite], most // len(curves)) for curve in curves]
    there = [np.isfinite(part[finite]).astype(int) for part in parts]
    ends = [np.flatnonzero(np.diff(one))[:, None] + np.array([0, 1]) for one in there]
    within = [np.flatnonzero(one) for one in there]
    # Where little was simulated, as in a few short swings, all of it is drawn.
    ends += [one for one in within if len(one) <= most // len(curves)]
    return finite[np.unique(np.concatenate([*chosen, *(one.ravel() for one in ends)]))]


def _starts(t: Float[Array, " N"], rows: Int[Array, " n"], measured: Float[Array, " N"]) -> list[int]:
    """Which of the kept rows begin anew, behind a gap of all samples: of those alone steps are uneven."""
    there = np.isfinite(measured)
    begins = [gap_starts(t), np.flatnonzero(there[1:] & ~there[:-1]) + 1]
    return np.unique(np.searchsorted(rows, np.concatenate(begins))).tolist()


def _scaled(values: Float[Array, " n"]) -> dict[str, Any]:
    """A curve in whole steps: half the size of single precision; the lowest number stands for none."""
    there = np.isfinite(values)
    step = float(np.abs(values[there]).max(initial=0.0)) / _STEPS or 1.0
    return {"step": step, "values": _packed(np.where(there, np.round(values / step), -_STEPS - 1), "<i2")}


def _packed(values: Array, kind: str) -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode()
