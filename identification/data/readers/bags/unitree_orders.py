"""Orders of the motors that Unitree documents for its ``LowState``: quadrupeds of twelve joints, and the G1 of 29."""

from __future__ import annotations

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
"""Names of the joints as in the maker's own URDF files, by number of the motor."""
