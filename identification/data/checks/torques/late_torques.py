"""Finds recordings in which all torques are late relative to the motion by the same time.

Such torques were recorded late, or filtered. A slow drive cannot be the cause: with it, the commanded torque is early
relative to the motion. In a diagnosis, late torques would look like a coupling of joints, other inertias, or less
friction.
"""

from __future__ import annotations

import numpy as np

from identification.data.checks.torques.torque_lag import CLEARLY, SMALLEST, Lag, LowPass
from identification.data.readers.map_entries import entries_words
from identification.data.recording import Fault, Recording

# Smallest number of joints with a lag, and largest spread of their lags as a share of the median.
_JOINTS, _LARGEST_SPREAD = 2, 0.35
# Smallest share of the squared residual that a shift of the torque has to remove (median over the joints). If the shift
# removes less, something else is wrong.
_REMOVED = 0.75


def late_torques(recording: Recording, lags: list[Lag], low_passes: list[LowPass], step: float) -> Fault | None:
    """The fault of a recording whose torques are all late by the same time; None if they are not.

    Args:
        recording: The recording.
        lags: Significant lags of the torques.
        low_passes: The low pass that fits each of the same torques best in place of its lag.
        step: Time between two samples [s].
    """
    samples = np.array([lag.samples for lag in lags])
    if len(lags) < _JOINTS or samples.min() <= 0:
        return None
    median, removed = float(np.median(samples)), float(np.median([lag.removed for lag in lags]))
    if np.ptp(samples) > _LARGEST_SPREAD * median or removed < _REMOVED:
        return None
    seconds = median * step
    return Fault(
        f"the torques are late against their motion by {1e3 * seconds:.3g} ms",
        f"on {', '.join(lag.joint for lag in lags)} a shift takes away {100 * removed:.0f} % of what the model leaves, "
        "and no drive makes a torque late",
        _advice(recording, median, low_passes, step),
    )


def _advice(recording: Recording, samples: float, low_passes: list[LowPass], step: float) -> str:
    """Advice to undo a delay, a low pass, or one of the two if the motion does not separate them.

    A lag near a whole number of rows is rounded. Such a delay arises if the positions and torques of a row were read at
    different instants.

    Args:
        recording: The recording.
        samples: Lag of the torques in samples.
        low_passes: The low pass that fits each torque best in place of its lag.
        step: Time between two samples [s].
    """
    rows = round(samples)
    seconds = step * (rows if rows and abs(samples - rows) < SMALLEST / 2 else samples)
    delay = entries_words(recording, {"tau": f"{{late: {seconds:.3g}}}"})
    beside_shift = float(np.median([one.beside_shift for one in low_passes])) if low_passes else np.inf
    if beside_shift > 1 / CLEARLY:
        return delay
    hertz = float(np.median([one.hertz for one in low_passes]))
    low_pass = entries_words(recording, {"tau": f"{{low_pass: {hertz:.3g}}}"})
    if beside_shift < CLEARLY:
        return f"{low_pass}, which takes back a low pass of first order"
    return f"{delay}; or, if they went through a low pass of first order, {low_pass}"
