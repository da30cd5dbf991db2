"""Suspicions that torques are in another unit, before a gear, or motor currents, with one factor or one a joint.

Where the factors of the joints differ, either the drives do, or a load makes the torques of some joints larger: both
are tried, and what a robot like the model leaves decides.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import fminbound

from identification.data.checks.against_model import least_squares
from identification.data.checks.readings.plausible_fit import misfit_as_modelled
from identification.data.checks.readings.reading import Reading, varies, with_torques_times
from identification.data.checks.readings.suspects import TORQUE_UNITS, Suspect, names
from identification.data.checks.torques.torque_scales import ONE_FACTOR, OTHER_UNIT, OWN_FACTOR, torque_scales
from identification.data.readers.map_entries import gear_entries
from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.dynamics.dynamics import inverse_dynamics, modelled_friction
from phantom_dyn.errors import listed
from phantom_dyn.model.robot import Robot

# Largest distance of a factor from that of a unit or gear, as a logarithm: masses and torque constants may be wrong.
_NEAR = float(np.log(1.5))
# The same where only the standard deviations of torques are compared, as friction may be most of a torque.
_SIZE = float(np.log(3.0))
# A load makes the measured torques larger, and the factors smaller: that of all joints is sought from the smallest one
# to so many times the largest, in as many steps.
_LOADED, _STEPS = 6.0, 13
# Share of a voltage that follows the speed, and what it grows with the speed over modelled viscous friction.
_MOSTLY, _STEEP = 0.9, 10.0


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
    if np.any(gears > np.exp(OTHER_UNIT)):
        readings.append(("on the motor's side of the gear", "", gears))
    out = []
    for what, option, factors in readings:
        joints = _joints_with(scales, sizes, np.where(np.abs(np.log(factors)) > OTHER_UNIT, factors, np.nan))
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


def factor_suspects(robot: Robot, reading: Reading) -> list[Suspect]:
    """The suspicions that all torques have one factor, and that each has its own; empty for usual factors.

    Args:
        robot: The given model.
        reading: The recorded data.
    """
    scales = torque_scales(robot, reading)
    logs = np.log(scales)
    known = ~np.isnan(logs)
    far = np.nan_to_num(np.abs(logs)) > OTHER_UNIT
    if not far.any() or robot.nv == 1:
        return []
    each = _of_each(robot, reading, scales, far)
    voltage = _voltage(robot, each.read(reading), each)
    if voltage is not None:
        return [voltage]
    if known.sum() > 1 and np.ptp(logs[known]) < ONE_FACTOR:
        return [factor_of_all(robot, float(np.exp(logs[known].mean())))]
    one_way = known.sum() > 1 and (np.all(logs[known] > OWN_FACTOR) or np.all(logs[known] < -OWN_FACTOR))
    return [*([_beside_a_load(robot, reading, scales)] if one_way else []), each]


def _voltage(robot: Robot, reading: Reading, each: Suspect) -> Suspect | None:
    """The suspicion of motor voltages, if the torques with their factors grow with the speed as no friction does.

    Most of a motor's voltage is the back-EMF, which is proportional to its speed.

    Args:
        robot: The given model.
        reading: The data with the factors of the torques.
        each: The suspicion of these factors.
    """
    model = inverse_dynamics(robot, reading.motion) - modelled_friction(robot, reading.motion)
    felt = reading.tau + reading.external
    shares = np.zeros(robot.nv)
    for j in np.flatnonzero(varies(felt)):
        v = reading.motion.v[:, j]
        columns = np.column_stack([model[:, j], v, reading.sign[:, j], np.ones(len(v))])
        slope = least_squares(columns, felt[:, j])[0][1]
        if slope > _STEEP * robot.viscous_friction[j]:
            shares[j] = slope**2 * v.var() / felt[:, j].var()
    joints = np.flatnonzero(shares >= _MOSTLY)
    if not set(each.joints) <= set(joints.tolist()):
        return None
    every = names(robot, joints.tolist())
    columns = listed([f"u.{robot.joint_names[j]}" for j in joints])
    return replace(
        each,
        kind="voltage",
        what=f"the torques of {every} are no torques: they follow the speeds of these joints, to "
        f"{100 * shares[joints].min():.3g} % or more, as motor voltages do",
        entries={},
        advice=f"if they are voltages, name the columns {columns}, and state torque_constant, resistance and "
        "gear_ratio in robot.yaml; else record torques",
    )


def _beside_a_load(robot: Robot, reading: Reading, scales: Float[Array, " nv"]) -> Suspect:
    """The suspicion of one factor of all torques with which a robot like the model, with a load, leaves least."""

    def misfit(log: float) -> float:
        return misfit_as_modelled(robot, with_torques_times(reading, np.full(robot.nv, np.exp(log))))

    low = float(np.log(np.nanmin(scales)))
    high = float(np.log(np.nanmax(scales) * _LOADED))
    tried = np.linspace(low, high, _STEPS)
    about, step = tried[int(np.argmin([misfit(log) for log in tried]))], tried[1] - tried[0]
    factor = float(np.exp(fminbound(misfit, about - step, about + step, xtol=0.01)))
    found = factor_of_all(robot, factor)
    return replace(found, what=f"{found.what}, less where the robot has no load, and more with a larger one", price=2)


def factor_of_all(robot: Robot, factor: float) -> Suspect:
    """The suspicion of one factor of all torques."""
    every = tuple(range(robot.nv))
    what = (
        f"the torques are on the motor's side of gears of about {factor:.3g}"
        if factor > 1
        else f"the torques are about {1 / factor:.3g} times what they should be on all joints"
    )
    return Suspect(
        "torque",
        every,
        f"{what}, or motor currents with about {factor:.2g} N m/A",
        gear_entries(robot, {j: f"gear: {factor:.3g}" for j in every}),
        lambda reading: with_torques_times(reading, np.full(robot.nv, factor)),
        price=1,
    )


def _of_each(robot: Robot, reading: Reading, scales: Float[Array, " nv"], far: Bool[Array, " nv"]) -> Suspect:
    """The suspicion of a factor of its own for each torque."""
    # A joint whose motion does not determine its factor gets that of the others, if the sizes of its torques agree.
    middle = np.full(robot.nv, np.exp(np.median(np.log(scales[far]))))
    alike = np.isin(np.arange(robot.nv), _joints_with(scales, _sizes(robot, reading), middle))
    scales = np.where(np.isnan(scales) & alike, middle, scales)
    joints = tuple(np.flatnonzero(np.nan_to_num(np.abs(np.log(scales))) > OWN_FACTOR).tolist())
    factor = np.where(np.isin(np.arange(robot.nv), joints), scales, 1.0)
    units = ["N/A" if robot.prismatic[j] else "N m/A" for j in joints]
    per = [f"{scales[j]:.2g} {unit} on {robot.joint_names[j]}" for j, unit in zip(joints, units, strict=True)]
    unknown = tuple(np.flatnonzero(np.isnan(scales)).tolist())
    rest = f" (the motion does not show that of {names(robot, unknown)})" if unknown else ""
    be = "torques of {} look" if len(joints) > 1 else "torque of {} looks"
    return Suspect(
        "gears" if np.nanmin(scales[list(joints)]) > 1 else "factors",
        joints,
        f"the {be.format(names(robot, joints))} like motor current, or like torque before the gear, and not like "
        f"torque at the joint, with a factor of about {listed(per)}{rest}",
        gear_entries(robot, {j: f"gear: {scales[j]:.3g}" for j in joints}),
        lambda reading: with_torques_times(reading, factor),
        price=1,
    )
