"""Finds positions that were recorded on the motor's side of a gear, and estimates the gear ratios.

Such positions are the joint's positions times the gear ratio, which may be negative. The ratios are those with which
the model explains the torques of all joints best. The weight of the links determines the ratio of a revolute joint, as
it depends on the angle; without weight, the inertia determines the ratio.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import fminbound, minimize

from identification.data.checks.readings.plausible_fit import ENOUGH, misfit_as_modelled
from identification.data.checks.readings.reading import Reading, with_positions_times
from identification.data.checks.readings.suspects import Suspect, names
from identification.data.checks.torques.scaled_model import quick_unexplained
from identification.data.readers.map_entries import joint_entries
from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import ChainError
from phantom_dyn.model.robot import Robot

# Gear ratios of revolute joints, and of screws [rad/m], that are tried, in steps of four per cent: a minimum is wider.
_GEARS, _SCREWS = np.geomspace(1.25, 500.0, 150), np.geomspace(10.0, 1e4, 176)
# Factors that are then tried on the ratio of each joint in turn, and number of rounds over all joints.
_FACTORS, _ROUNDS = np.geomspace(0.2, 5.0, 81), 2
# Largest number of fits per joint in the last search, over all ratios at once.
_FITS_PER_JOINT = 60
# A ratio within the second factor of 57.3 is not reported, because degrees explain it: the model is no more accurate.
_DEGREES, _DEGREES_FACTOR = 180 / np.pi, 1.01
# As for degrees, but for millimetres. The factor is larger, as only the inertia determines the ratio.
_MILLIMETRES, _MILLIMETRES_FACTOR = 1e3, 1.2
# If more joints than this move too far, they are tried only together.
_MOST_JOINTS = 3
# Angle [rad] and travel [m] beyond which a position may be that of a motor.
_FAR, _FARTHEST = 2 * np.pi, 20.0
# Penalty on the factor between torque and model, for data that fit with any ratio (if only inertia acts): weight,
# logarithm of a usual factor, and upper limit of the squared ratio of logarithms.
_WEIGHT, _USUAL_FACTOR, _LARGEST_SQUARE = 0.05, float(np.log(1.5)), 20.0
# Logarithm of the largest factor between ratios that count as equal.
_EQUAL_RATIOS = float(np.log(1.03))


def motor_side_suspects(robot: Robot, reading: Reading) -> list[Suspect]:
    """Suspected gears of joints that move too far: of all these joints together, and of each by itself.

    Args:
        robot: The given model.
        reading: The recorded data.
    """
    most = np.abs(reading.motion.q).max(axis=0)
    turning = np.flatnonzero(~robot.prismatic & (most > _FAR)).tolist()
    sliding = np.flatnonzero(robot.prismatic & (np.ptp(reading.motion.q, axis=0) > _FARTHEST)).tolist()
    sets = [tuple(joints) for joints in (turning, sliding) if joints]
    sets += [(j,) for joints in (turning, sliding) if 1 < len(joints) <= _MOST_JOINTS for j in joints]
    out = []
    for joints in sets:
        ratios = _best_ratios(robot, reading, joints)
        linear = robot.prismatic[joints[0]]
        unit, near = (_MILLIMETRES, _MILLIMETRES_FACTOR) if linear else (_DEGREES, _DEGREES_FACTOR)
        if np.any(np.abs(np.log(np.maximum(ratios[list(joints)], 1e-9) / unit)) > np.log(near)):
            out.append(_suspect(robot, joints, ratios))
    return out


def _best_ratios(robot: Robot, reading: Reading, joints: tuple[int, ...]) -> Float[Array, " nv"]:
    """Gear ratios with which the torques fit best; negative if the motor turns the other way, 1 for other joints.

    A common ratio of all joints is found first, then the ratio of each joint in turn, then all at once.
    """
    at = list(joints)

    def misfit(ratios: Float[Array, " nv"]) -> float:
        """Sum of the logarithms of the unexplained shares of all joints' torques, with the penalty on their factors."""
        try:
            shares, factors = quick_unexplained(robot, with_positions_times(reading, 1 / ratios))
        except ChainError:
            return np.inf
        unusual = np.minimum((np.log(np.maximum(factors, 1e-9)) / _USUAL_FACTOR) ** 2, _LARGEST_SQUARE)
        return float(np.sum(np.log(shares + ENOUGH)) + _WEIGHT * np.sum(unusual))

    def with_ratio(ratios: Float[Array, " nv"], which: list[int], ratio: float) -> Float[Array, " nv"]:
        out = ratios.copy()
        out[which] = ratio
        return out

    grid = _SCREWS if robot.prismatic[at[0]] else _GEARS
    start = np.ones(robot.nv)
    ratios = min((with_ratio(start, at, sign * ratio) for ratio in grid for sign in (1, -1)), key=misfit)
    for _ in range(_ROUNDS if len(at) > 1 else 0):
        for j in at:
            near = [with_ratio(ratios, [j], sign * ratios[j] * factor) for factor in _FACTORS for sign in (1, -1)]
            ratios = min((ratios, *near), key=misfit)

    def moved(logs: Float[Array, " k"]) -> Float[Array, " nv"]:
        out = ratios.copy()
        out[at] = out[at] * np.exp(logs)
        return out

    step = float(np.log(grid[1] / grid[0]))
    logs_of_factors = np.zeros(len(at))
    if len(at) > 1:
        simplex = np.vstack([logs_of_factors, step * np.eye(len(at))])
        options = {"initial_simplex": simplex, "maxfev": _FITS_PER_JOINT * len(at), "xatol": 2e-3, "fatol": 1e-3}
        logs_of_factors = minimize(
            lambda logs: misfit(moved(logs)), logs_of_factors, method="Nelder-Mead", options=options
        ).x
    if robot.prismatic[at[0]]:
        # The weight on a linear joint does not depend on its position, so that it cannot refine the ratio.
        return moved(logs_of_factors)

    def with_load(log: float) -> float:
        return misfit_as_modelled(robot, with_positions_times(reading, 1 / moved(logs_of_factors + log)))

    return moved(logs_of_factors + float(np.asarray(fminbound(with_load, -3 * step, 3 * step, xtol=5e-3))))


def _suspect(robot: Robot, joints: tuple[int, ...], ratios: Float[Array, " nv"]) -> Suspect:
    """The suspected mistake that positions of joints are those of their motors; equal ratios are averaged."""
    of_joints = ratios[list(joints)]
    one = np.ptp(np.log(np.abs(of_joints))) < _EQUAL_RATIOS and len(set(np.sign(of_joints))) == 1
    if one:
        ratios = ratios.copy()
        ratios[list(joints)] = float(np.sign(of_joints[0]) * np.exp(np.mean(np.log(np.abs(of_joints)))))
        of_joints = ratios[list(joints)][:1]
    directions = [", which turns the other way round" if ratio < 0 else "" for ratio in of_joints]
    unit = " rad/m" if robot.prismatic[joints[0]] else ""
    ratio_words = [f"{abs(ratio):.3g}{unit}{direction}" for ratio, direction in zip(of_joints, directions, strict=True)]
    be = "position of {} is" if len(joints) == 1 else "positions of {} are"
    gear = "a gear" if one else "gears"
    return Suspect(
        "degrees" if not robot.prismatic[joints[0]] else "length",
        joints,
        f"the {be.format(names(robot, joints))} on the motor's side of {gear} of about {', '.join(ratio_words)}",
        joint_entries(
            robot, "q", {j: f"gear: {abs(ratios[j]):.3g}{', sign: -1' if ratios[j] < 0 else ''}" for j in joints}
        ),
        lambda reading: with_positions_times(reading, 1 / ratios),
        moves=True,
        turned=not robot.prismatic[joints[0]],
        price=1,
        fits_gears=True,
    )
