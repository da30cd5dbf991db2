"""How large a residual is expected to be at each moment: noise, the model's error, reversals and standing joints.

The error of a model grows with the torque that it explains, noise does not. A residual that is large where the torque
is large is no event.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from identification.diagnosis import decision_rules as rules
from phantom_dyn.array_types import Array, Bool, Float, Int

# Median of the square of a standard normal number.
_MEDIAN_SQUARE = 0.4549
# Degrees of freedom of the law by which sizes are fitted: events weigh little in it.
_FREEDOM = 4.0
_STEPS = 60
_LEAST_SAMPLES = 20


@dataclass(frozen=True)
class Causes:
    """Squared torques of one joint that make a residual larger at some moments than at others.

    Attributes:
        known: Variance that is known beforehand [torque^2], ``(n,)``: of joints that stand or turn about.
        torque: Square of the moving part of the modelled torque and of its change, at its largest nearby, ``(n,)``.
        reversals: True near reversals of the velocity, ``(n,)``.
    """

    known: Float[Array, " n"]
    torque: Float[Array, " n"]
    reversals: Bool[Array, " n"]


def moving_torque(torque: Float[Array, " n"], rate_hz: float, cutoff_hz: float) -> Float[Array, " n"]:
    """Square of a joint's torque about its median, and of its change within the band, at its largest nearby.

    A steady torque is balanced by the fit; what moves shows errors of inertia, of timing and of derivatives.

    Args:
        torque: Modelled torque in the band.
        rate_hz: Of its samples.
        cutoff_hz: Edge of the band, whose filter carries a peak that far.
    """
    change = np.gradient(torque) * rate_hz / (np.pi * cutoff_hz)
    reach = 2 * int(np.ceil(rate_hz / cutoff_hz)) + 1
    return ndimage.maximum_filter1d((torque - np.median(torque)) ** 2 + change**2, reach, axis=0)


def expected_error(
    residual: Float[Array, " n"], causes: Causes, use: Bool[Array, " n"], fold: Int[Array, " n"]
) -> Float[Array, " n"]:
    """Standard deviation of a residual at each sample, estimated without the fold of the sample.

    The variance is that of the noise, the known one, a share of the squared torque and a part near reversals. The noise
    is the median of the calmer half; the rest is fitted with a heavy-tailed law beside a part for events, so that these
    do not raise it.

    Args:
        residual: What the explanation leaves.
        causes: What it may grow with.
        use: Samples that count.
        fold: Samples of one number are judged by the others.
    """
    out = np.full(len(residual), np.nan)
    for number in np.unique(fold):
        train, here = use & (fold != number), fold == number
        if np.count_nonzero(train) < _LEAST_SAMPLES:
            train = use
        out[here] = np.sqrt(_variance(residual, causes, train)[here])
    return out


def _variance(residual: Array, causes: Causes, use: Array) -> Array:
    usual = float(np.median(causes.torque[use]))
    calm = use & (causes.torque <= usual) & (causes.known <= np.median(causes.known[use]))
    calm = calm if np.count_nonzero(calm) >= _LEAST_SAMPLES else use
    noise = max(float(np.median(residual[calm] ** 2)) / _MEDIAN_SQUARE, 1e-300)
    known = noise + causes.known
    # Events come whatever the torque is: a part that is the same at all times takes them up, and is not expected.
    events = np.full(len(residual), noise)
    # What the model is wrong by at the usual torque is in the noise already.
    more = np.maximum(causes.torque - usual, 0.0)
    parts = np.column_stack([more, noise * causes.reversals, events])
    least = np.array([rules.MODEL_SHARE**2, 0.0, 0.0])
    grown = _grown(residual[use], known[use], parts[use], least)
    return known + parts[:, :2] @ grown[:2]


def _grown(
    residual: Float[Array, " n"], known: Float[Array, " n"], parts: Float[Array, "n k"], least: Float[Array, " k"]
) -> Float[Array, " k"]:
    """Coefficients of variances beside a known one: the likeliest by Student's law, by multiplicative steps."""
    largest = np.maximum(parts.max(axis=0), 1e-300)
    out = np.maximum(least, 0.01 * known.min() / largest)
    for _ in range(_STEPS):
        variance = known + parts @ out
        weight = (_FREEDOM + 1.0) / (_FREEDOM + residual**2 / variance)
        seen = (weight * residual**2 / variance**2) @ parts
        due = np.maximum((1.0 / variance) @ parts, 1e-300)
        out = np.maximum(out * np.sqrt(seen / due), least)
    return out
