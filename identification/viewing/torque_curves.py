"""Computes measured and modelled torques in the judged band, and relative residuals for the joints' colours."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from identification.data.log import Log
from identification.data.signals import within_limits
from identification.diagnosis.columns.operations import operation_of
from identification.diagnosis.columns.session import session_of_logs
from identification.diagnosis.columns.terms import KnownEffect
from phantom_dyn.array_types import Array, Float
from phantom_dyn.model.robot import Robot

WINDOW_S = 0.2
"""Time [s] over which a residual is averaged for its colour; without averaging, it would flicker at zero crossings."""
LEAST_FULL, MOST_FULL = 0.1, 1.0
"""Limits of the relative residual (residual divided by the joint's rms torque) that is shown in full colour. Below the
lower limit, noise alone would look like a gap. A model without any torque has a relative residual of 1."""
_PER_PERIOD = 12.0
"""Smallest number of samples of a curve per period of the highest frequency, if the recording has that many."""
_LARGEST = 99.0
"""Percentile over time that counts as the largest residual, so that a single spike does not define the colours."""


@dataclass(frozen=True, eq=False)
class TorqueCurves:
    """Torque of the drives [N m or N] in the judged band; NaN for samples that must not be used.

    Attributes:
        t: Times [s], ``(m,)``.
        measured: Recorded torque, ``(m, nv)``.
        modelled: Torque that each model needs for the recorded motion, ``(m, nv)`` each.
    """

    t: Float[Array, " m"]
    measured: Float[Array, "m nv"]
    modelled: tuple[Float[Array, "m nv"], ...]

    def residual(self, model: int) -> Float[Array, "m nv"]:
        """Measured minus modelled torque."""
        return self.measured - self.modelled[model]


def torque_curves(
    log: Log, cutoff_hz: float, models: tuple[tuple[Robot, tuple[KnownEffect, ...]], ...]
) -> TorqueCurves:
    """Measured and modelled torque along a recording.

    Args:
        log: The recording.
        cutoff_hz: Upper edge of the judged band [Hz].
        models: Robots, each with additional effects of its model.
    """
    # At the sample rate of fits, curves would look jagged.
    fine = max(1, min(log.band.step, int(log.band.rate_hz / (_PER_PERIOD * cutoff_hz))))
    drawn = replace(log, band=replace(log.band, step=fine))
    session = session_of_logs(models[0][0], (drawn,), cutoff_hz)

    def in_band(torque: Float[Array, "N nv"]) -> Float[Array, "m nv"]:
        judged = session.log_in_judged_band(drawn.band(torque), 0)
        return np.where(drawn.valid_in_band[:, None], judged, np.nan)

    modelled = tuple(in_band(operation_of(robot, log, effects, band_hz=cutoff_hz).tau) for robot, effects in models)
    return TorqueCurves(log.motion.t[drawn.samples], in_band(within_limits(log.tau, models[0][0])), modelled)


def relative_residuals(curves: TorqueCurves) -> tuple[Float[Array, "m nv"], ...]:
    """Moving root mean square of each model's residual over `WINDOW_S`, divided by the rms of the measured torque.

    The rms of the measured torque is that of the whole recording. The ratio is zero for a joint without torque.
    """
    measured_rms = _root_mean_square(curves.measured)
    count = max(1, round(WINDOW_S / float(np.median(np.diff(curves.t)))))
    with np.errstate(divide="ignore", invalid="ignore"):
        return tuple(
            np.nan_to_num(_moving_rms(curves.residual(k), count) / measured_rms, nan=0.0, posinf=0.0)
            for k in range(len(curves.modelled))
        )


def full_colour(given: Float[Array, "m nv"]) -> float:
    """Relative residual that is shown in full colour: about the largest of the given model, within limits.

    Args:
        given: Relative residual of the given model.
    """
    return float(np.clip(np.percentile(given, _LARGEST, axis=0).max(), LEAST_FULL, MOST_FULL))


def _root_mean_square(x: Float[Array, "m nv"]) -> Float[Array, " nv"]:
    known = np.isfinite(x)
    return np.sqrt((np.where(known, x, 0.0) ** 2).sum(axis=0) / np.maximum(known.sum(axis=0), 1))


def _moving_rms(x: Float[Array, "m nv"], count: int) -> Float[Array, "m nv"]:
    """Root mean square of the finite values among the ``count`` samples around each sample; NaN if none is finite."""
    kernel = np.ones(min(count, len(x)))
    known = np.isfinite(x)
    squares = np.where(known, x, 0.0) ** 2
    sums = np.column_stack([np.convolve(column, kernel, mode="same") for column in squares.T])
    counts = np.column_stack([np.convolve(column, kernel, mode="same") for column in known.T.astype(float)])
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.sqrt(np.maximum(sums, 0.0) / np.where(counts > 0.5, counts, np.nan))
