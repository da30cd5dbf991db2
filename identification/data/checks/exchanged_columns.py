"""Exchanged columns of positions and torques, found by how well a plausible robot explains either order.

As with the other readings of `identification.data.checks.better_readings`, no plausible robot may explain the data as
recorded, and one has to explain them after the exchange. The thresholds are stricter: this reading has another motion,
and a torque must not be taken for a position because it happens to fit as one.
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

# Unexplained share of the torque that every joint has to exceed as recorded, and no joint after the exchange. Exchanged
# recordings in tests have 0.8 and more against 0.01 and less.
_AS_IT_STANDS, _EXCHANGED = 0.5, 0.05


def exchanged_columns(recording: Recording, robot: Robot, reading: Reading) -> Fault | None:
    """The fault of a recording whose positions and torques are exchanged on all joints; None where they are not.

    Args:
        recording: Raw samples.
        robot: The given model.
        reading: Some of its samples, smoothed.
    """
    # Torques that were computed from a current, and recordings with forces, are not tested.
    if recording.tau is None or recording.forces or set(recording.torque_from.values()) - {"tau"}:
        return None
    before = unexplained(robot, reading)
    if np.isnan(before).all() or np.nanmin(before) < _AS_IT_STANDS:
        return None
    smooth = smoothed(replace(recording, q=recording.tau, tau=recording.q, v=None))
    other = None if smooth is None else reading_of(smooth)
    if other is None:
        return None
    try:
        after = unexplained(robot, other)
    except ChainError:
        return None
    if np.isnan(after).all() or np.nanmax(after) > _EXCHANGED:
        return None
    return Fault(
        "positions and torques are in each other's columns",
        f"as recorded {100 * min(1.0, float(np.nanmin(before))):.0f} % of every torque is left unexplained; "
        f"the other way round {max(100 * float(np.nanmax(after)), 0.1):.2g} % are left",
        entries_words(recording, {"q": '"tau.{joint}"', "tau": '"q.{joint}"'}),
    )
