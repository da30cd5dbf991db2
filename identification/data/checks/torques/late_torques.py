"""Finds recordings in which all torques are late against the motion by the same time.

Then the torques were recorded late or filtered: a slow drive makes the commanded torque early against the motion, not
late. In a diagnosis, late torques would look like a coupling of joints, other inertias or less friction.
"""

from __future__ import annotations

import numpy as np

from identification.data.checks.torques.torque_lag import Lag
from identification.data.readers.map_entries import entries_words
from identification.data.recording import Fault, Recording

# Smallest number of joints with a lag, and largest spread of their lags as a share of the median.
_JOINTS, _LARGEST_SPREAD = 2, 0.35
# Smallest share of the squared residual that a shift of the torque removes (median over the joints): if it removes
# less, something else is wrong.
_REMOVED = 0.75


def late_torques(recording: Recording, lags: list[Lag], step: float) -> Fault | None:
    """The fault of a recording whose torques are all late by the same time; None if they are not.

    Args:
        recording: The recording.
        lags: Significant lags of the torques.
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
        entries_words(recording, {"tau": f"{{low_pass: {1 / (2 * np.pi * seconds):.3g}}}"})
        + ", which takes back a low pass of first order or a delay that is short beside the motion",
    )
