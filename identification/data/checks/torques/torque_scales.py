"""Torques that are logged in another unit on each joint (motor currents), found by weight and inertia of the links.

Drives of different sizes have different torques per ampere, so each joint has its own factor. It is the torque of the
modelled links over the logged one, fitted beside friction of any size, and is as accurate as that model.
"""

from __future__ import annotations

import numpy as np

from identification.data.checks.against_model import regress_joints
from identification.data.checks.readings import Reading, with_torques_plus, with_torques_times
from identification.data.checks.suspects import Suspect, names
from identification.data.readers.map_entries import gear_entries
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.dynamics import inverse_dynamics, modelled_friction
from phantom_dyn.errors import listed
from phantom_dyn.model.robot import Robot

# Logarithm of a factor that is too large for a wrong torque constant or inertia.
_OTHER_UNIT = float(np.log(4.0))
# Logarithm from which a joint gets its own factor, if another joint has one of the above size.
_OWN = float(np.log(1.5))
# Joints whose factors differ by less than a factor of two share one.
_AGREE = float(np.log(2.0))
# Largest difference of the logarithms from both halves of a recording; least share of the torque that is explained.
_ALIKE, _SHARE = float(np.log(1.3)), 0.5


def torque_scales(robot: Robot, reading: Reading) -> Float[Array, " nv"]:
    """Modelled torque [N m or N] per unit of the measured one; NaN for joints whose motion does not show it.

    Args:
        robot: The given model.
        reading: The recorded data.
    """
    model = inverse_dynamics(robot, reading.motion) - modelled_friction(robot, reading.motion)
    found = regress_joints(with_torques_plus(reading, reading.external), model)
    out = np.full(robot.nv, np.nan)
    for j, one in enumerate(found):
        if one is None or one.model_share < _SHARE or min(one.slope) <= 0:
            continue
        if abs(np.log(one.slope[0] / one.slope[1])) < _ALIKE:
            out[j] = 2.0 / sum(one.slope)
    return out


def common_scale(scales: Float[Array, " nv"]) -> float | None:
    """Modelled torque per unit of the measured one, if it is the same on all joints that show it; else None.

    A load that the model lacks gives one factor on all joints, too; on a single joint the two look the same.

    Args:
        scales: Scale of each joint, see `torque_scales`.
    """
    known = scales[~np.isnan(scales)]
    if not len(known) or np.abs(np.log(known)).min() <= _OTHER_UNIT or np.ptp(np.log(known)) >= _AGREE:
        return None
    return float(np.exp(np.mean(np.log(known))))


def load_or_current(robot: Robot, scales: Float[Array, " nv"]) -> tuple[str, dict[str, str]] | None:
    """Possible causes of one factor on all torques, and the entries of a column map if the torques are currents.

    Args:
        robot: The given model.
        scales: Scale of each joint, see `torque_scales`.

    Returns:
        The first part of a sentence, and the entries; None if the joints do not share a factor.
    """
    scale = common_scale(scales)
    if scale is None:
        return None
    joints = tuple(np.flatnonzero(~np.isnan(scales)).tolist())
    units = sorted({"N/A" if robot.prismatic[j] else "N m/A" for j in joints})
    load = "carries a load or is heavier" if scale < 1 else "is lighter"
    which, are, alike = ("torque", "is", "") if len(joints) == 1 else ("torques", "are", ", all alike")
    return (
        f"the {which} of {names(robot, joints)} {are} {1 / scale:.2g} times what weight "
        f"and inertia of the model need{alike}: if the robot {load} than its model, nothing is to be done, as the "
        f"diagnosis says so; if this is a motor current, with a factor of about {scale:.2g} {listed(units)}"
    ), gear_entries(robot, {j: f"gear: {scales[j]:.3g}" for j in joints})


def scale_suspects(robot: Robot, reading: Reading) -> list[Suspect]:
    """The suspicion that torques are in another unit on each joint, if some factor is too large for a torque constant.

    Args:
        robot: The given model.
        reading: The recorded data.
    """
    scales = torque_scales(robot, reading)
    size = np.abs(np.log(scales))
    far = np.nan_to_num(size) > _OTHER_UNIT
    # A load gives one factor on all joints too, see `load_or_current`.
    if not far.any() or common_scale(scales) is not None:
        return []
    joints = tuple(np.flatnonzero(np.nan_to_num(size) > _OWN).tolist())
    factor = np.where(np.isin(np.arange(robot.nv), joints), scales, 1.0)
    units = ["N/A" if robot.prismatic[j] else "N m/A" for j in joints]
    per = [f"{scales[j]:.2g} {unit} on {robot.joint_names[j]}" for j, unit in zip(joints, units, strict=True)]
    open_ = tuple(np.flatnonzero(np.isnan(scales)).tolist())
    rest = f" (the motion does not tell that of {names(robot, open_)})" if open_ else ""
    return [
        Suspect(
            "torque",
            joints,
            f"the torque of {names(robot, joints)} looks like motor current and not like torque at the joint, with a "
            f"factor of about {listed(per)}{rest}",
            gear_entries(robot, {j: f"gear: {scales[j]:.3g}" for j in joints}),
            lambda reading: with_torques_times(reading, factor),
            says="offer",
        )
    ]
