"""Torque of each joint over the whole recording as numbers for the page, where it can be looked at closer."""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from identification.diagnosis.result import Diagnosis, Evidence
from identification.reporting.charts.thinning import thinned
from identification.reporting.page.gap_figures import residual, shown_stretch, torque_label
from phantom_dyn.array_types import Float, Int

Array = np.ndarray

SAMPLES = 30_000
"""Of all joints together: ten bytes each, so that the page stays small."""
_OF_ONE = 6_000
"""Samples of one joint at most: more than a screen has points, and several times over."""
_STEPS = 32_767
"""Steps of a curve from zero to its largest value: finer than a screen shows, even where it is looked at closer."""


def time_curves(diagnosis: Diagnosis, joints: Sequence[int]) -> str:
    """Torque that was measured and that both models leave, over time, as JSON for ``curve_viewer.js``.

    Args:
        diagnosis: Holds the samples.
        joints: Which joints are shown.

    Returns:
        A list with one entry a joint: where on the page it is drawn, axis labels, noise band, the stretch that is shown
        at first, and the curves, little-endian numbers in base64.
    """
    most = min(_OF_ONE, SAMPLES // max(len(joints), 1))
    return json.dumps([_curves(diagnosis, joint, most) for joint in joints])


def _curves(diagnosis: Diagnosis, joint: int, most: int) -> dict[str, Any]:
    evidence, gap = diagnosis.evidence, diagnosis.joints[joint]
    before, after = (residual(tau, evidence, joint) for tau in (evidence.tau_before, evidence.tau_after))
    rows = _kept(evidence, joint, (before, after), most)
    # At rest there are few samples, far apart.
    stretch = evidence.t if diagnosis.at_rest else evidence.t[shown_stretch(evidence, joint)]
    return {
        "id": f"curves-{joint}",
        "torque": torque_label(diagnosis, joint),
        "residual": f"residual [{gap.unit}]",
        "unit": gap.unit,
        "floor": 2 * gap.noise_floor if np.isfinite(gap.noise_floor) else 0,
        "view": [float(stretch[0]), float(stretch[-1])],
        "t": _packed(evidence.t[rows], "<f4"),
        "measured": _scaled(evidence.tau_measured[rows, joint]),
        "before": _scaled(before[rows]),
        "after": _scaled(after[rows]),
    }


def _kept(evidence: Evidence, joint: int, residuals: tuple[Array, ...], most: int) -> Int[Array, " n"]:
    """Rows whose values are numbers, at most ``most``, with the extremes of every curve."""
    curves = (evidence.tau_measured[:, joint], *residuals)
    finite = np.flatnonzero(np.isfinite(np.column_stack(curves)).all(axis=1))
    if len(finite) <= most:
        return finite
    chosen = [thinned(curve[finite], most // len(curves)) for curve in curves]
    return finite[np.unique(np.concatenate(chosen))]


def _scaled(values: Float[Array, " n"]) -> dict[str, Any]:
    """A curve in whole steps: half the size of single precision."""
    step = float(np.abs(values).max(initial=0.0)) / _STEPS or 1.0
    return {"step": step, "values": _packed(np.round(values / step), "<i2")}


def _packed(values: Array, kind: str) -> str:
    return base64.b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode()
