"""Finds joints with a drive whose torque is zero in every row, because it was not recorded."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identification.data.checks.readings.reading import Reading
from identification.data.recording import Fault, Recording
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.errors import listed
from phantom_dyn.model.robot import Robot

# In a joint without a drive, the torques of weight and inertia cancel: their sum is below this share of the two
# together.
_CANCELS = 0.3
# Smallest travel [rad or m] of a joint that moves.
_MOVES = 0.01


def missing_torque(recording: Recording, robot: Robot, reading: Reading, needed: Float[Array, "N nv"]) -> Fault | None:
    """The fault of joints with a drive whose torque is zero in every row, although their motion needs a torque.

    Args:
        recording: Raw samples.
        robot: The given model.
        reading: Smoothed samples of the recording.
        needed: Torque that the model without friction needs at the same samples [N m or N], from the drives and
            measured forces together.
    """
    if recording.tau is None:
        return None
    still = np.zeros_like(reading.motion.v)
    weight = inverse_dynamics(robot, replace(reading.motion, v=still, a=still))
    rms = np.sqrt(np.mean((needed - reading.external) ** 2, axis=0))
    parts = np.sqrt(np.mean(weight**2 + (needed - weight) ** 2, axis=0))
    driven = np.array([actuator.actuated and actuator.drive_known for actuator in robot.actuators])
    empty = driven & ~recording.tau.any(axis=0) & (np.ptp(recording.q, axis=0) > _MOVES) & (rms > _CANCELS * parts)
    names = [recording.joint_names[j] for j in np.flatnonzero(empty)]
    if not names:
        return None
    one = len(names) == 1
    needs = listed([f"{rms[j]:.3g} {robot.torque_units[j]}" for j in np.flatnonzero(empty)])
    entries = ", ".join(f"{name}: {{drive: unknown}}" for name in names)
    return Fault(
        f"the torque of {listed(names)} is 0 in every row",
        f"{'it moves' if one else 'they move'}, for which the model needs {needs} (root mean square)",
        f"record {'it' if one else 'them'}; until then state {entries} in robot.yaml, so that the other joints are "
        f"judged, or actuated: false for a joint without a drive",
    )
