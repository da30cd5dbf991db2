"""Torque and position of each joint over the whole recording as numbers for the page, to be looked at closer."""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from identification.diagnosis.evidence import Evidence
from identification.diagnosis.result import Diagnosis
from identification.reporting.charts.thinning import gap_starts, thinned
from identification.reporting.page.gap_figures import (
    position_unit,
    residual,
    shown_motion,
    shown_stretch,
    torque_label,
)
from phantom_dyn.array_types import Array, Float, Int

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
    t: Float[Array, " N"], stretch: Float[Array, " n"], rows: Int[Array, " n"], curves: tuple[Array, Array, Array]
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
