"""Torques that all come after their motion by the same time: the log has them late or filtered, as no drive can be.

A drive that is slow has a torque that is early against its motion. A log in which the torques are late shows a
coupling, other bodies or less friction where nothing is wrong.
"""

from __future__ import annotations

import numpy as np

from identification.data.checks.torques.torque_lag import Lag
from identification.data.readers.map_entries import entries_words
from identification.data.recording import Fault, Recording

# Least number of joints that agree, and how far apart their lags may be as a share of the middle one.
_JOINTS, _APART = 2, 0.35
# Least share of the squares left that goes when the torque of a middle joint is shifted: little else is wrong.
_REMOVED = 0.75


def late_torques(recording: Recording, lags: list[Lag], step: float) -> Fault | None:
    """The fault of a log whose torques are all late against their motion; None where they are not, or other things are.

    Args:
        recording: Its entries so far.
        lags: Of the torques of all joints that show one, each beyond its error.
        step: Time between two samples [s].
    """
    samples = np.array([lag.samples for lag in lags])
    if len(lags) < _JOINTS or samples.min() <= 0:
        return None
    middle, removed = float(np.median(samples)), float(np.median([lag.removed for lag in lags]))
    if np.ptp(samples) > _APART * middle or removed < _REMOVED:
        return None
    seconds = middle * step
    return Fault(
        f"the torques are late against their motion by {1e3 * seconds:.3g} ms",
        f"on {', '.join(lag.joint for lag in lags)} a shift takes away {100 * removed:.0f} % of what the model leaves, "
        "and no drive makes a torque late",
        entries_words(recording, {"tau": f"{{low_pass: {1 / (2 * np.pi * seconds):.3g}}}"})
        + ", which takes back a low pass of first order or a delay that is short beside the motion",
    )
