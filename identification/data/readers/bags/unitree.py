"""Reads the inertial sensor and the foot contacts from Unitree's message ``LowState``.

The messages name no frames. The sensor is assumed to be at the link ``imu``, as in the maker's files of quadrupeds. The
force of a foot is an integer without a unit, with one level in the air and another one on the ground.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from phantom_dyn.array_types import Array, Float

_LEGS = tuple(f"{leg}_{part}_joint" for leg in ("FR", "FL", "RR", "RL") for part in ("hip", "thigh", "calf"))
_LEG = ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")
_WAIST = ("waist_yaw", "waist_roll", "waist_pitch")
_ARM = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow", "wrist_roll", "wrist_pitch", "wrist_yaw")
_SIDES = ("left", "right")
_G1 = (
    *(f"{side}_{part}_joint" for side in _SIDES for part in _LEG),
    *(f"{part}_joint" for part in _WAIST),
    *(f"{side}_{part}_joint" for side in _SIDES for part in _ARM),
)
MOTOR_ORDERS = (_LEGS, _G1)
"""Joint names in the order of the motors, as in the maker's own URDF files: quadrupeds and G1."""

FEET = ("FR_foot", "FL_foot", "RR_foot", "RL_foot")
"""Feet in the order of the maker's documentation."""
_LEAST_SPREADS = 3.0
"""Smallest difference between the two levels of a force, in standard deviations of the lower level."""
_LEAST_COUNTS = 10.0
"""Smallest difference between the two levels of a force, in its own unit."""
_SENSED = tuple(f"{quantity}.imu.{axis}" for quantity in ("w", "sf") for axis in "xyz")


def base_values(message: Any) -> Float[Array, " 10"]:
    """Angular velocity [rad/s], specific force [m/s^2] and forces of four feet in a message; NaN without forces."""
    imu = message.imu_state if hasattr(message, "imu_state") else message.imu
    feet = getattr(message, "foot_force", getattr(message, "footForce", np.full(4, np.nan)))
    return np.concatenate([imu.gyroscope, imu.accelerometer, feet]).astype(float)


def base_columns(file: str, values: Sequence[Float[Array, " 10"]]) -> tuple[Mapping[str, Array], tuple[str, ...]]:
    """Columns of the sensor and of contacts, and a sentence on contacts; both empty if all readings are zero.

    Args:
        file: Name of the bag, for messages.
        values: Readings of each message, as `base_values` returns them.
    """
    every = np.array(values).reshape(-1, 10)
    if not every[:, :6].any():
        return {}, ()
    columns = dict(zip(_SENSED, every.T, strict=False))
    levels = {foot: level for foot, force in zip(FEET, every[:, 6:].T, strict=True) if (level := threshold(force))}
    for foot, level in levels.items():
        columns[f"contact.{foot}"] = (every[:, 6 + FEET.index(foot)] > level).astype(float)
    if not levels:
        return columns, ()
    level_words = ", ".join(f"{level:.0f} of {foot}" for foot, level in levels.items())
    return columns, (
        f"{file}: a foot counts as on the ground from a force on of {level_words} (halfway between two levels).",
    )


def threshold(force: Float[Array, " N"]) -> float | None:
    """Force halfway between its two levels; None without two levels.

    The sorted values are split into two clusters with the smallest sum of squared deviations from their means.
    """
    if not np.isfinite(force).all():
        return None
    ordered = np.sort(force)
    count = np.arange(1, len(ordered))
    sums, squares = np.cumsum(ordered)[:-1], np.cumsum(ordered**2)[:-1]
    low_deviation = squares - sums**2 / count
    high_deviation = (np.sum(ordered**2) - squares) - (ordered.sum() - sums) ** 2 / (len(ordered) - count)
    k = int(np.argmin(low_deviation + high_deviation))
    low, high = ordered[: k + 1], ordered[k + 1 :]
    distance = float(high.mean() - low.mean())
    if distance < max(_LEAST_COUNTS, _LEAST_SPREADS * float(low.std())):
        return None
    return float(0.5 * (low.mean() + high.mean()))
