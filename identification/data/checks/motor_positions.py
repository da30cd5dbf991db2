"""Finds positions that were recorded on the motor's side of a gear, and estimates the gear ratios.

Such positions are the joint's positions times the gear ratio, which may be negative. The estimated ratios are those
with which the model explains the torques of all joints best. The weight of the links depends on the angle, and so
determines the ratio of a revolute joint. Without weight, the inertia determines the ratio.
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

# Gear ratios that are tried, of revolute joints and of screws [rad/m], in steps of four per cent: a minimum of the
# misfit is wider.
_GEARS, _SCREWS = np.geomspace(1.25, 500.0, 150), np.geomspace(10.0, 1e4, 176)
# Factors that are then tried on the ratio of each joint in turn, and the number of rounds over all joints.
_FACTORS, _ROUNDS = np.geomspace(0.2, 5.0, 81), 2
# Largest number of fits per joint in the last search, over all ratios at once.
_FITS_PER_JOINT = 60
# A ratio that differs from 57.3 by less than the second factor is not reported, because degrees explain it as well. The
# estimate is no more accurate than this factor.
_DEGREES, _DEGREES_FACTOR = 180 / np.pi, 1.01
# A ratio near 1000 is not reported, because millimetres explain it as well. The factor is larger, because only the
# inertia determines the ratio of a linear joint.
_MILLIMETRES, _MILLIMETRES_FACTOR = 1e3, 1.2
# If more joints than this move too far, only a mistake of all these joints is tried.
_MOST_JOINTS = 3
# Angle [rad] and travel [m] beyond which a joint moves too far, so that its position may be that of the motor.
_FAR, _FARTHEST = 2 * np.pi, 20.0
# Penalty on the factor of the model torque. It decides if only inertia acts, as the data then fit with any ratio. The
# penalty is the first number times the square of the factor's logarithm over the second number, and this square is at
# most the third number.
_WEIGHT, _USUAL_FACTOR, _LARGEST_SQUARE = 0.05, float(np.log(1.5)), 20.0
# Ratios within three per cent, of which this is the logarithm, count as equal.
_EQUAL_RATIOS = float(np.log(1.03))


def motor_side_suspects(robot: Robot, reading: Reading) -> list[Suspect]:
    """The suspected mistakes that positions are those of motors: of all joints that move too far, or of one.

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

    A common ratio of ``joints`` is found first, then the ratio of each joint in turn, then all ratios at once. Ratios
    of revolute joints are last multiplied by a common factor, for a robot that may carry a load.
    """
    at = list(joints)

    def misfit(ratios: Float[Array, " nv"]) -> float:
        """Sum over all joints of the logarithm of the unexplained share, plus the penalty on the factor."""
        try:
            shares, factors = quick_unexplained(robot, with_positions_times(reading, 1 / ratios))
        except ChainError:
            return np.inf
        unusual = np.minimum((np.log(np.maximum(factors, 1e-9)) / _USUAL_FACTOR) ** 2, _LARGEST_SQUARE)
        return float(np.sum(np.log(shares + ENOUGH)) + _WEIGHT * np.sum(unusual))

    def with_ratio(ratios: Float[Array, " nv"], which: list[int], ratio: float) -> Float[Array, " nv"]:
        """The ratios, with the same ``ratio`` for the joints ``which``."""
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

    def scaled(logs: Float[Array, " k"]) -> Float[Array, " nv"]:
        """The ratios, with those of ``joints`` times factors that are given by their logarithms."""
        out = ratios.copy()
        out[at] = out[at] * np.exp(logs)
        return out

    step = float(np.log(grid[1] / grid[0]))
    logs_of_factors = np.zeros(len(at))
    if len(at) > 1:
        simplex = np.vstack([logs_of_factors, step * np.eye(len(at))])
        options = {"initial_simplex": simplex, "maxfev": _FITS_PER_JOINT * len(at), "xatol": 2e-3, "fatol": 1e-3}
        logs_of_factors = minimize(
            lambda logs: misfit(scaled(logs)), logs_of_factors, method="Nelder-Mead", options=options
        ).x
    if robot.prismatic[at[0]]:
        # The weight on a linear joint does not depend on the joint's position, so that it cannot refine the ratio.
        return scaled(logs_of_factors)

    def misfit_with_load(log: float) -> float:
        """Misfit of a robot like its model that may carry a load, with all ratios times a common factor."""
        return misfit_as_modelled(robot, with_positions_times(reading, 1 / scaled(logs_of_factors + log)))

    return scaled(logs_of_factors + float(np.asarray(fminbound(misfit_with_load, -3 * step, 3 * step, xtol=5e-3))))


def _suspect(robot: Robot, joints: tuple[int, ...], ratios: Float[Array, " nv"]) -> Suspect:
    """The suspected mistake that positions of joints are those of their motors; equal ratios are averaged."""
    of_joints = ratios[list(joints)]
    all_equal = np.ptp(np.log(np.abs(of_joints))) < _EQUAL_RATIOS and len(set(np.sign(of_joints))) == 1
    if all_equal:
        ratios = ratios.copy()
        ratios[list(joints)] = float(np.sign(of_joints[0]) * np.exp(np.mean(np.log(np.abs(of_joints)))))
        of_joints = ratios[list(joints)][:1]
    directions = [", which turns the other way round" if ratio < 0 else "" for ratio in of_joints]
    unit = " rad/m" if robot.prismatic[joints[0]] else ""
    ratio_words = [f"{abs(ratio):.3g}{unit}{direction}" for ratio, direction in zip(of_joints, directions, strict=True)]
    subject = "position of {} is" if len(joints) == 1 else "positions of {} are"
    gear = "a gear" if all_equal else "gears"
    return Suspect(
        "degrees" if not robot.prismatic[joints[0]] else "length",
        joints,
        f"the {subject.format(names(robot, joints))} on the motor's side of {gear} of about {', '.join(ratio_words)}",
        joint_entries(
            robot, "q", {j: f"gear: {abs(ratios[j]):.3g}{', sign: -1' if ratios[j] < 0 else ''}" for j in joints}
        ),
        lambda reading: with_positions_times(reading, 1 / ratios),
        moves=True,
        turned=not robot.prismatic[joints[0]],
        price=1,
    )
