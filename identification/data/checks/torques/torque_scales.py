"""Torques in a wrong unit on some joints or on all (such as motor currents), found by weight and inertia of the links.

Drives of different sizes have different torques per ampere, so each joint has its own factor: modelled torque of the
links over logged torque, fitted together with friction of any size. It is as accurate as the model.
"""

from __future__ import annotations

import numpy as np

from identification.data.checks.against_model import regress_joints
from identification.data.checks.readings.reading import Reading, with_torques_plus, with_torques_times
from identification.data.checks.readings.suspects import TORQUE_UNITS, Suspect, names
from identification.data.readers.map_entries import gear_entries
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.dynamics import inverse_dynamics, modelled_friction
from phantom_dyn.errors import listed
from phantom_dyn.model.robot import Robot

# Logarithm of a factor that is too large for a wrong torque constant or inertia.
_OTHER_UNIT = float(np.log(4.0))
# Logarithm from which a joint gets a factor, if another joint has one of the size above.
_OWN = float(np.log(1.5))
# Largest difference of the logarithms of factors that count as one factor of all joints.
_AGREE = float(np.log(2.0))
# Largest distance of a factor from that of a unit or gear, as a logarithm: masses and torque constants may be wrong.
_NEAR = float(np.log(1.5))
# The same where only the standard deviations of torques are compared, as friction may be most of a torque.
_SIZE = float(np.log(3.0))
# Largest difference of the logarithms of factors that agree closely, as those of currents of equal drives do, and the
# smallest logarithm of such a factor: torque constants may be wrong by a factor of two.
_ONE_FACTOR, _BEYOND_CONSTANT = float(np.log(1.15)), float(np.log(2.5))
# Largest difference of the logarithms of factors from both halves of a recording, and the smallest share of the torque
# that the model has to explain.
_ALIKE, _SHARE = float(np.log(1.3)), 0.5


def torque_scales(robot: Robot, reading: Reading) -> Float[Array, " nv"]:
    """Modelled torque [N m or N] per unit of the measured one; NaN for joints whose motion does not determine it.

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
    """Modelled torque per unit of the measured one, if it is the same for all joints with a known one; else None.

    A load that the model lacks also gives about one factor for all joints. With a single joint the two cannot be
    distinguished. If several joints agree closely, a smaller factor is enough.

    Args:
        scales: Scale of each joint, see `torque_scales`.
    """
    logs = np.log(scales[~np.isnan(scales)])
    if not len(logs):
        return None
    smallest, spread = float(np.abs(logs).min()), float(np.ptp(logs))
    if smallest > _OTHER_UNIT and spread < _AGREE:
        return float(np.exp(np.mean(logs)))
    close = len(logs) > 1 and spread < _ONE_FACTOR
    return float(np.exp(np.mean(logs))) if close and smallest > _BEYOND_CONSTANT else None


def load_or_current(robot: Robot, scales: Float[Array, " nv"]) -> tuple[str, dict[str, str]] | None:
    """Possible causes of torques that are off by one factor on all joints or by large factors on some, as currents are.

    Args:
        robot: The given model.
        scales: Scale of each joint, see `torque_scales`.

    Returns:
        The first part of a sentence, and the entries of a column map for the case that the torques are currents. None
        if the factors are those of usual torques.
    """
    size, scale = np.nan_to_num(np.abs(np.log(scales))), common_scale(scales)
    if scale is None and size.max(initial=0.0) <= _OTHER_UNIT:
        return None
    far = ~np.isnan(scales) if scale is not None else size > _OWN
    joints = tuple(np.flatnonzero(far).tolist())
    units = listed(sorted({"N/A" if robot.prismatic[j] else "N m/A" for j in joints}))
    which, are, alike = ("torque", "is", "") if len(joints) == 1 else ("torques", "are", ", all alike")
    entries = gear_entries(robot, {j: f"gear: {scales[j]:.3g}" for j in joints})
    if scale is None:
        times, factors = listed([f"{1 / scales[j]:.2g}" for j in joints]), listed([f"{scales[j]:.2g}" for j in joints])
        return (
            f"the {which} of {names(robot, joints)} {are} {times} times what weight and inertia of the model need: if "
            f"the model lacks so much of the robot, nothing is to be done; if this is a motor current, with a factor "
            f"of about {factors} {units}"
        ), entries
    load = "carries a load or is heavier" if scale < 1 else "is lighter"
    return (
        f"the {which} of {names(robot, joints)} {are} {1 / scale:.2g} times what weight "
        f"and inertia of the model need{alike}: if the robot {load} than its model, nothing is to be done, as the "
        f"diagnosis says so; if this is a motor current, with a factor of about {scale:.2g} {units}"
    ), entries


def unit_suspects(robot: Robot, reading: Reading) -> list[Suspect]:
    """Suspicions that torques of some joints, but not of all, are in another unit, or before the stated gear.

    Args:
        robot: The given model.
        reading: The recorded data.
    """
    scales, sizes = torque_scales(robot, reading), _sizes(robot, reading)
    gears = np.array([abs(actuator.gear_ratio) for actuator in robot.actuators])
    # Only smaller units: a joint without a drive has a small torque, which would look like one in kN m.
    units = [(unit, factor) for unit, factor in TORQUE_UNITS.items() if factor < 1]
    readings = [(f"in {unit} and not in N m", f"unit: {unit}", np.full(robot.nv, factor)) for unit, factor in units]
    if np.any(gears > np.exp(_OTHER_UNIT)):
        readings.append(("on the motor's side of the gear", "", gears))
    out = []
    for what, option, factors in readings:
        joints = _joints_with(scales, sizes, np.where(np.abs(np.log(factors)) > _OTHER_UNIT, factors, np.nan))
        if not joints or len(joints) == robot.nv:
            continue
        factor = np.where(np.isin(np.arange(robot.nv), joints), factors, 1.0)
        given = gear_entries(robot, {j: option or f"gear: {gears[j]:.6g}" for j in joints})
        be = "torques of {} are" if len(joints) > 1 else "torque of {} is"
        out.append(
            Suspect(
                "torque",
                joints,
                f"the {be.format(names(robot, joints))} {what}",
                given,
                lambda reading, factor=factor: with_torques_times(reading, factor),
            )
        )
    return out


def _sizes(robot: Robot, reading: Reading) -> Float[Array, " nv"]:
    """Size of the modelled torque, with friction, over that of the measured one; NaN where either is constant."""
    needed = inverse_dynamics(robot, reading.motion).std(axis=0)
    size = (reading.tau + reading.external).std(axis=0)
    known = (needed > 0) & (size > 0)
    return np.where(known, needed / np.where(known, size, 1.0), np.nan)


def _joints_with(
    scales: Float[Array, " nv"], sizes: Float[Array, " nv"], factors: Float[Array, " nv"]
) -> tuple[int, ...]:
    """Joints whose torque has one of the factors by weight and inertia; if there are any, also those by size alone."""
    by_scale = np.nan_to_num(np.abs(np.log(scales / factors)), nan=np.inf) < _NEAR
    by_size = np.nan_to_num(np.abs(np.log(sizes / factors)), nan=np.inf) < _SIZE
    return tuple(np.flatnonzero(by_scale | by_size).tolist()) if by_scale.any() else ()


def scale_suspects(robot: Robot, reading: Reading) -> list[Suspect]:
    """The suspicion that the torque of each joint is in a unit of its own, as currents are; empty for usual factors.

    Args:
        robot: The given model.
        reading: The recorded data.
    """
    scales = torque_scales(robot, reading)
    far = np.nan_to_num(np.abs(np.log(scales))) > _OTHER_UNIT
    # One factor on all joints may also be a load, see `load_or_current`.
    if not far.any() or common_scale(scales) is not None:
        return []
    # A joint whose motion does not determine its factor gets that of the others, if the sizes of its torques agree.
    middle = np.full(robot.nv, np.exp(np.median(np.log(scales[far]))))
    alike = _joints_with(scales, _sizes(robot, reading), middle)
    scales[list(alike)] = np.where(np.isnan(scales), middle, scales)[list(alike)]
    size = np.abs(np.log(scales))
    joints = tuple(np.flatnonzero(np.nan_to_num(size) > _OWN).tolist())
    factor = np.where(np.isin(np.arange(robot.nv), joints), scales, 1.0)
    units = ["N/A" if robot.prismatic[j] else "N m/A" for j in joints]
    per = [f"{scales[j]:.2g} {unit} on {robot.joint_names[j]}" for j, unit in zip(joints, units, strict=True)]
    unknown = tuple(np.flatnonzero(np.isnan(scales)).tolist())
    rest = f" (the motion does not show that of {names(robot, unknown)})" if unknown else ""
    return [
        Suspect(
            "torque",
            joints,
            f"the torque of {names(robot, joints)} looks like motor current, or like torque before the gear, and not "
            f"like torque at the joint, with a factor of about {listed(per)}{rest}",
            gear_entries(robot, {j: f"gear: {scales[j]:.3g}" for j in joints}),
            lambda reading: with_torques_times(reading, factor),
            says="offer",
        )
    ]
