"""Estimates the factor between each recorded torque and the modelled one, to find wrong units and motor currents.

Drives of different sizes have different torques per ampere, so each joint has its own factor: modelled torque of the
links over recorded torque, fitted together with friction of any size. The factor is as accurate as the model.
"""

from __future__ import annotations

import numpy as np

from identification.data.checks.against_model import least_squares, regress_joints
from identification.data.checks.readings.reading import Reading, with_torques_plus
from identification.data.checks.readings.suspects import names
from identification.data.readers.map_entries import joint_entries
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.dynamics import inverse_dynamics, modelled_friction
from phantom_dyn.errors import listed
from phantom_dyn.model.robot import Robot

OTHER_UNIT = float(np.log(4.0))
"""Logarithm of the factor from which on a wrong torque constant or inertia cannot be the cause."""
OWN_FACTOR = float(np.log(1.5))
"""Logarithm above which a joint gets a factor of its own, if the factor of another joint is above `OTHER_UNIT`."""
ONE_FACTOR = float(np.log(1.15))
"""Factors are equal if their logarithms differ by at most this number: links are usually modelled this accurately."""
# Smallest logarithm of a common factor of several joints: torque constants may be wrong by a factor of two.
_BEYOND_CONSTANT = float(np.log(2.5))
# Largest difference between the logarithms of a factor in the two halves of a recording.
_SAME_IN_HALVES = float(np.log(1.3))
# A factor is known if the links explain more than the first share of the torque's variance, or if they explain more
# than the second number times the unexplained share.
_SHARE, _CLEAR = 0.5, 10.0
# Logarithm of the largest ratio between a factor from a constant weight and the factor from inertia.
_SAME_AS_INERTIA = float(np.log(2.0))


def torque_scales(robot: Robot, reading: Reading) -> Float[Array, " nv"]:
    """Modelled torque [N m or N] per unit of the measured one, shape ``(nv,)``; NaN where the motion does not show it.

    Friction may be most of a torque, and back-EMF most of a voltage. So the share that the links explain is compared
    with the unexplained share, and not with the whole torque.

    Args:
        robot: The given model.
        reading: The recorded data.
    """
    model = inverse_dynamics(robot, reading.motion) - modelled_friction(robot, reading.motion)
    with_external = with_torques_plus(reading, reading.external)
    out = np.full(robot.nv, np.nan)
    for j, regression in enumerate(regress_joints(with_external, model)):
        if regression is None:
            continue
        # The slope is the ratio of measured to modelled torque. Rotor inertia and friction under load can only raise
        # the slope: so one that is not high is used even if the links explain a small share of the torque.
        not_raised = 0 < max(regression.slope) < np.exp(OWN_FACTOR)
        clear = not_raised and regression.model_share > _CLEAR * regression.unexplained
        if regression.model_share > _SHARE or clear:
            slopes = regression.slope
        else:
            slopes = _by_weight(
                model[:, j],
                with_external.motion.v[:, j],
                with_external.sign[:, j],
                with_external.tau[:, j],
                regression.slope,
            )
        if min(slopes) > 0 and abs(np.log(slopes[0] / slopes[1])) < _SAME_IN_HALVES:
            out[j] = 2.0 / sum(slopes)
    return out


def _by_weight(
    model: Float[Array, " N"],
    v: Float[Array, " N"],
    sign: Float[Array, " N"],
    tau: Float[Array, " N"],
    varying_slopes: tuple[float, float],
) -> tuple[float, float]:
    """Ratio of measured to modelled torque in each half, from a nearly constant weight such as a hoist's; 0 if unknown.

    An offset would take up such a weight, so that this fit has no offset. If a spring or counterweight balances the
    weight, the varying part of the modelled torque has another ratio; then both results are zero.

    Args:
        model: Modelled torque.
        v: Velocity.
        sign: Sign of the velocity.
        tau: Measured torque.
        varying_slopes: Ratio in each half from the varying part of the modelled torque, by a fit with an offset.
    """
    columns, half, slopes = np.column_stack([model, v, sign]), len(tau) // 2, []
    for rows in (slice(None, half), slice(half, None)):
        x, residual = least_squares(columns[rows], tau[rows])
        gain = least_squares(columns[rows, 1:], tau[rows])[1] - residual
        slopes.append(float(x[0]) if gain > _CLEAR * residual else 0.0)
    if (
        min(*slopes, *varying_slopes) <= 0
        or max(slopes) > np.exp(OWN_FACTOR)
        or abs(np.log(sum(slopes) / sum(varying_slopes))) > _SAME_AS_INERTIA
    ):
        return 0.0, 0.0
    return slopes[0], slopes[1]


def common_scale(scales: Float[Array, " nv"]) -> float | None:
    """The factor from measured to modelled torque that all joints with a known factor have in common; None without one.

    A load that the model lacks can imitate a factor, on a single joint most easily. So a single joint needs a larger
    factor than several joints that agree.

    Args:
        scales: Result of `torque_scales`, shape ``(nv,)``.
    """
    logs = np.log(scales[~np.isnan(scales)])
    if not len(logs) or np.ptp(logs) > ONE_FACTOR:
        return None
    enough = _BEYOND_CONSTANT if len(logs) > 1 else OTHER_UNIT
    return float(np.exp(np.mean(logs))) if np.abs(logs).min() > enough else None


def load_or_current(robot: Robot, scales: Float[Array, " nv"]) -> tuple[str, dict[str, str]] | None:
    """Words on torques that differ from the modelled ones by a common factor, or by large factors on some joints.

    The cause may be a load that the model lacks, or that the torques are motor currents.

    Args:
        robot: The given model.
        scales: Result of `torque_scales`, shape ``(nv,)``.

    Returns:
        The first part of a sentence, and the entries of a column map for the case that the torques are currents. None
        if the factors are those of usual torques.
    """
    size, scale = np.nan_to_num(np.abs(np.log(scales))), common_scale(scales)
    if scale is None and size.max(initial=0.0) <= OTHER_UNIT:
        return None
    concerned = ~np.isnan(scales) if scale is not None else size > OWN_FACTOR
    joints = tuple(np.flatnonzero(concerned).tolist())
    units = listed(sorted({"N/A" if robot.prismatic[j] else "N m/A" for j in joints}))
    which, are, alike = ("torque", "is", "") if len(joints) == 1 else ("torques", "are", ", all alike")
    entries = joint_entries(robot, "tau", {j: f"gear: {scales[j]:.3g}" for j in joints})
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
        f"and inertia of the model need{alike}: if the robot {load} than its model, nothing has to be done: the "
        f"diagnosis will say so; if this is a motor current, with a factor of about {scale:.2g} {units}"
    ), entries
