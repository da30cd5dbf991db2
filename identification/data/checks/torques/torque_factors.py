"""Lists suspected mistakes of torques by a factor: another unit, the motor's side of a gear, motor currents, voltages.

The factor may be common to all joints, or each joint may have its own. If the factors differ, either the drives differ,
or the factor is common and a load increases the torques of some joints. Both causes are tried, and the one is chosen
with which a robot like the model fits better.
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
from identification.data.readers.map_entries import joint_entries
from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.dynamics.dynamics import inverse_dynamics, modelled_friction
from phantom_dyn.errors import listed
from phantom_dyn.model.robot import Robot

# An estimated factor is that of a unit or gear if their ratio is below 1.5, of which this is the logarithm: masses and
# torque constants may be wrong.
_NEAR = float(np.log(1.5))
# The same limit for a factor that was estimated from the standard deviations of the torques only: friction may be most
# of a torque.
_SIZE = float(np.log(3.0))
# A load makes the measured torques larger, and so the estimated factors smaller. So the common factor is looked for
# from the smallest estimate up to `_LARGEST_LOAD` times the largest, in `_STEPS` steps.
_LARGEST_LOAD, _STEPS = 6.0, 13
# A torque is a motor voltage if the part that is proportional to the velocity has at least the first share of the
# torque's variance, and is more than the second number times the modelled viscous friction.
_VOLTAGE_SHARE, _VISCOUS_RATIO = 0.9, 10.0


def unit_suspects(robot: Robot, reading: Reading) -> list[Suspect]:
    """The suspected mistakes that torques of some joints, not of all, are in another unit or on the motor's side.

    Args:
        robot: The given model.
        reading: The recorded data.
    """
    scales, sizes = torque_scales(robot, reading), _sizes(robot, reading)
    gears = np.array([abs(actuator.gear_ratio) for actuator in robot.actuators])
    # Only smaller units: a joint without a drive has a small torque, which would look like one in kN m.
    units = [(unit, factor) for unit, factor in TORQUE_UNITS.items() if factor < 1]
    causes = [(f"in {unit} and not in N m", f"unit: {unit}", np.full(robot.nv, factor)) for unit, factor in units]
    if np.any(gears > np.exp(OTHER_UNIT)):
        causes.append(("on the motor's side of the gear", "", gears))
    out = []
    for what, option, factors in causes:
        joints = _joints_with(scales, sizes, np.where(np.abs(np.log(factors)) > OTHER_UNIT, factors, np.nan))
        if not joints or len(joints) == robot.nv:
            continue
        factor = np.where(np.isin(np.arange(robot.nv), joints), factors, 1.0)
        given = joint_entries(robot, "tau", {j: option or f"gear: {gears[j]:.6g}" for j in joints})
        subject = "torques of {} are" if len(joints) > 1 else "torque of {} is"
        out.append(
            Suspect(
                "torque",
                joints,
                f"the {subject.format(names(robot, joints))} {what}",
                given,
                lambda reading, factor=factor: with_torques_times(reading, factor),
            )
        )
    return out


def _sizes(robot: Robot, reading: Reading) -> Float[Array, " nv"]:
    """Standard deviation of the modelled torque, with friction, over that of the measured torque, shape ``(nv,)``.

    NaN where either torque is constant.
    """
    needed = inverse_dynamics(robot, reading.motion).std(axis=0)
    size = (reading.tau + reading.external).std(axis=0)
    known = (needed > 0) & (size > 0)
    return np.where(known, needed / np.where(known, size, 1.0), np.nan)


def _joints_with(
    scales: Float[Array, " nv"], sizes: Float[Array, " nv"], factors: Float[Array, " nv"]
) -> tuple[int, ...]:
    """Joints whose recorded torque differs from the modelled one by a given factor; empty if no ``scales`` show it.

    Args:
        scales: Estimated factor of each joint, NaN if the motion does not determine it.
        sizes: Ratio of the standard deviations of modelled and measured torque. If any joint has its factor by
            ``scales``, this ratio decides for the others.
        factors: The factor that is tested on each joint, NaN for none.
    """
    by_scale = np.nan_to_num(np.abs(np.log(scales / factors)), nan=np.inf) < _NEAR
    by_size = np.nan_to_num(np.abs(np.log(sizes / factors)), nan=np.inf) < _SIZE
    return tuple(np.flatnonzero(by_scale | by_size).tolist()) if by_scale.any() else ()


def factor_suspects(robot: Robot, reading: Reading) -> list[Suspect]:
    """The suspected mistakes that the torques have a common wrong factor, or each torque its own.

    Empty if no factor is so far from 1 that a wrong torque constant or inertia cannot be the cause, or for a single
    joint.

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
    each = _own_factors(robot, reading, scales, far)
    voltage = _voltage_suspect(robot, each.read(reading), each)
    if voltage is not None:
        return [voltage]
    if known.sum() > 1 and np.ptp(logs[known]) < ONE_FACTOR:
        return [factor_of_all(robot, float(np.exp(logs[known].mean())))]
    # Only factors that are all above or all below 1 can come from a common factor and a load.
    one_way = known.sum() > 1 and (np.all(logs[known] > OWN_FACTOR) or np.all(logs[known] < -OWN_FACTOR))
    return [*([_common_factor_with_load(robot, reading, scales)] if one_way else []), each]


def _voltage_suspect(robot: Robot, reading: Reading, each: Suspect) -> Suspect | None:
    """The suspected mistake that torques are motor voltages; None unless they grow with speed far more than friction.

    Most of a motor's voltage is the back-EMF, which is proportional to the speed.

    Args:
        robot: The given model.
        reading: The data with the torques corrected by ``each``.
        each: The suspected mistake that each torque has a factor of its own.
    """
    model = inverse_dynamics(robot, reading.motion) - modelled_friction(robot, reading.motion)
    torque = reading.tau + reading.external
    shares = np.zeros(robot.nv)
    for j in np.flatnonzero(varies(torque)):
        v = reading.motion.v[:, j]
        columns = np.column_stack([model[:, j], v, reading.sign[:, j], np.ones(len(v))])
        slope = least_squares(columns, torque[:, j])[0][1]
        if slope > _VISCOUS_RATIO * robot.viscous_friction[j]:
            shares[j] = slope**2 * v.var() / torque[:, j].var()
    joints = np.flatnonzero(shares >= _VOLTAGE_SHARE)
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


def _common_factor_with_load(robot: Robot, reading: Reading, scales: Float[Array, " nv"]) -> Suspect:
    """The suspected mistake of a common factor, estimated for a robot like the model that may carry a load."""

    def misfit(log: float) -> float:
        return misfit_as_modelled(robot, with_torques_times(reading, np.full(robot.nv, np.exp(log))))

    low = float(np.log(np.nanmin(scales)))
    high = float(np.log(np.nanmax(scales) * _LARGEST_LOAD))
    tried = np.linspace(low, high, _STEPS)
    best, step = tried[int(np.argmin([misfit(log) for log in tried]))], tried[1] - tried[0]
    found = factor_of_all(robot, float(np.exp(fminbound(misfit, best - step, best + step, xtol=0.01))))
    return replace(found, what=f"{found.what}, less where the robot has no load, and more with a larger one", price=2)


def factor_of_all(robot: Robot, factor: float) -> Suspect:
    """The suspected mistake that all torques have the same wrong factor.

    Args:
        robot: Gives the joints.
        factor: Factor from measured to modelled torque.
    """
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
        joint_entries(robot, "tau", {j: f"gear: {factor:.3g}" for j in every}),
        lambda reading: with_torques_times(reading, np.full(robot.nv, factor)),
        price=1,
    )


def _own_factors(robot: Robot, reading: Reading, scales: Float[Array, " nv"], far: Bool[Array, " nv"]) -> Suspect:
    """The suspected mistake that each torque has a wrong factor of its own.

    Args:
        robot: The given model.
        reading: The recorded data.
        scales: Factor of each joint, NaN if the motion does not determine it.
        far: True for joints whose factor is too far from 1 for a wrong torque constant or inertia.
    """
    # A joint whose motion does not determine its factor gets the median factor, if the standard deviations of its
    # measured and modelled torque agree with it.
    median = np.full(robot.nv, np.exp(np.median(np.log(scales[far]))))
    alike = np.isin(np.arange(robot.nv), _joints_with(scales, _sizes(robot, reading), median))
    scales = np.where(np.isnan(scales) & alike, median, scales)
    joints = tuple(np.flatnonzero(np.nan_to_num(np.abs(np.log(scales))) > OWN_FACTOR).tolist())
    factor = np.where(np.isin(np.arange(robot.nv), joints), scales, 1.0)
    units = ["N/A" if robot.prismatic[j] else "N m/A" for j in joints]
    per = [f"{scales[j]:.2g} {unit} on {robot.joint_names[j]}" for j, unit in zip(joints, units, strict=True)]
    unknown = tuple(np.flatnonzero(np.isnan(scales)).tolist())
    exception = f" (the motion does not show that of {names(robot, unknown)})" if unknown else ""
    subject = "torques of {} look" if len(joints) > 1 else "torque of {} looks"
    return Suspect(
        "gears" if np.nanmin(scales[list(joints)]) > 1 else "factors",
        joints,
        f"the {subject.format(names(robot, joints))} like motor current, or like torque before the gear, and not like "
        f"torque at the joint, with a factor of about {listed(per)}{exception}",
        joint_entries(robot, "tau", {j: f"gear: {scales[j]:.3g}" for j in joints}),
        lambda reading: with_torques_times(reading, factor),
        price=1,
    )
