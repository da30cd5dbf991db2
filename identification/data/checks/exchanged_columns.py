"""Checks whether the columns of positions and torques are exchanged.

As in `identification.data.checks.better_readings`, the columns are exchanged if no plausible robot explains the data as
recorded, and a plausible robot explains the data after the exchange. The thresholds are stricter here, because the
exchange changes the motion, too, and torques may fit as positions by accident.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identification.data.checks.readings.plausible_fit import unexplained
from identification.data.checks.readings.reading import Reading, reading_of
from identification.data.checks.smoothed_copy import smoothed
from identification.data.readers.map_entries import entries_words
from identification.data.recording import Fault, Recording
from phantom_dyn.errors import ChainError
from phantom_dyn.model.robot import Robot

# The unexplained share of every torque has to be above the first number as recorded, and below the second number after
# the exchange. Exchanged recordings in tests have at least 0.8 as recorded and at most 0.01 after the exchange.
_LEAST_AS_RECORDED, _MOST_EXCHANGED = 0.5, 0.05


def exchanged_columns(recording: Recording, robot: Robot, reading: Reading) -> Fault | None:
    """The fault that positions and torques of all joints are in each other's columns; None if they are not.

    Args:
        recording: Raw samples.
        robot: The given model.
        reading: Smoothed samples of the recording, in the units and order of the file.
    """
    # Torques that were computed from another quantity, and recordings with forces, are not tested.
    if recording.tau is None or recording.forces or set(recording.torque_from.values()) - {"tau"}:
        return None
    before = unexplained(robot, reading)
    if np.isnan(before).all() or np.nanmin(before) < _LEAST_AS_RECORDED:
        return None
    smooth = smoothed(replace(recording, q=recording.tau, tau=recording.q, v=None))
    exchanged = None if smooth is None else reading_of(smooth)
    if exchanged is None:
        return None
    try:
        after = unexplained(robot, exchanged)
    except ChainError:
        return None
    if np.isnan(after).all() or np.nanmax(after) > _MOST_EXCHANGED:
        return None
    return Fault(
        "positions and torques are in each other's columns",
        f"as recorded {100 * min(1.0, float(np.nanmin(before))):.0f} % of every torque is left unexplained; "
        f"the other way round {max(100 * float(np.nanmax(after)), 0.1):.2g} % are left",
        entries_words(recording, {"q": '"tau.{joint}"', "tau": '"q.{joint}"'}),
    )
