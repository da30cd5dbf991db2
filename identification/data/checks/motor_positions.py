"""Positions that are recorded on the motor's side of gears of unknown ratios, found by what the links need.

Read so, a joint turns, or slides on a screw, as many times as far as it does, perhaps the other way round. The ratios
are those with which the model explains the torques of all joints best. The weight of the links fixes that of a joint
that turns, as it depends on the angle itself; where there is no weight, the inertia does.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import fminbound, minimize

from identification.data.checks.readings.plausible_fit import ENOUGH, misfit_as_modelled
from identification.data.checks.readings.reading import Reading, with_positions_times
from identification.data.checks.readings.suspects import Suspect, names
from identification.data.checks.torques.scaled_model import quick_fit
from identification.data.readers.map_entries import position_entries
from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import ChainError
from phantom_dyn.model.robot import Robot

# Ratios of robots' gears, and turns of a screw [rad/m], in steps of four per cent, finer than the width of a minimum.
_GEARS, _SCREWS = np.geomspace(1.25, 500.0, 150), np.geomspace(10.0, 1e4, 176)
# Ratios of a joint over that of all which are tried for each in turn, as often as this.
_ABOUT, _ROUNDS = np.geomspace(0.2, 5.0, 81), 2
# Fits for each of them by which all are then made precise at once.
_EACH = 60
# A ratio so near to 57.3 is that of degrees: the two differ by less than the model is right.
_DEGREES, _NEAR = 180 / np.pi, 1.01
# The same of millimetres, where the inertia alone determines the ratio.
_MILLIMETRES, _ABOUT_AS_MUCH = 1e3, 1.2
# Where more joints move so far, one of them alone is not tried.
_MOST_JOINTS = 3
# Angle [rad] and way [m] below which a joint may move as it says.
_FAR, _FARTHEST = 2 * np.pi, 20.0
# Weight of the logarithm of a torque's factor, over that of a usual one, and its largest square: it decides where the
# torque fits with any ratio, as the inertia alone does.
_USUAL, _FACTOR, _MOST = 0.05, float(np.log(1.5)), 20.0
# Largest difference of the logarithms of ratios that are one.
_ONE_RATIO = float(np.log(1.03))


def motor_side_suspects(robot: Robot, reading: Reading) -> list[Suspect]:
    """The gears by which positions of joints that move too far are best divided: all at once, and each.

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
        unit, near = (_MILLIMETRES, _ABOUT_AS_MUCH) if robot.prismatic[joints[0]] else (_DEGREES, _NEAR)
        if np.any(np.abs(np.log(np.maximum(ratios[list(joints)], 1e-9) / unit)) > np.log(near)):
            out.append(_suspect(robot, joints, ratios))
    return out


def _best_ratios(robot: Robot, reading: Reading, joints: tuple[int, ...]) -> Float[Array, " nv"]:
    """The ratios, negative for motors that turn the other way round, with which torques fit best; 1 elsewhere.

    One ratio of all first, then that of each in turn.
    """
    at = list(joints)

    def misfit(ratios: Float[Array, " nv"]) -> float:
        """Sum of the logarithms of the unexplained shares of all joints' torques, with a price of unusual factors."""
        try:
            left, factors = quick_fit(robot, with_positions_times(reading, 1 / ratios))
        except ChainError:
            return np.inf
        unusual = np.minimum((np.log(np.maximum(factors, 1e-9)) / _FACTOR) ** 2, _MOST)
        return float(np.sum(np.log(left + ENOUGH)) + _USUAL * np.sum(unusual))

    def with_ratio(ratios: Float[Array, " nv"], which: list[int], ratio: float) -> Float[Array, " nv"]:
        out = ratios.copy()
        out[which] = ratio
        return out

    grid = _SCREWS if robot.prismatic[at[0]] else _GEARS
    start = np.ones(robot.nv)
    ratios = min((with_ratio(start, at, sign * ratio) for ratio in grid for sign in (1, -1)), key=misfit)
    for _ in range(_ROUNDS if len(at) > 1 else 0):
        for j in at:
            near = [with_ratio(ratios, [j], sign * ratios[j] * about) for about in _ABOUT for sign in (1, -1)]
            ratios = min((ratios, *near), key=misfit)

    def moved(logs: Float[Array, " k"]) -> Float[Array, " nv"]:
        out = ratios.copy()
        out[at] = out[at] * np.exp(logs)
        return out

    step = float(np.log(grid[1] / grid[0]))
    own = np.zeros(len(at))
    if len(at) > 1:
        simplex = np.vstack([own, step * np.eye(len(at))])
        options = {"initial_simplex": simplex, "maxfev": _EACH * len(at), "xatol": 2e-3, "fatol": 1e-3}
        own = minimize(lambda logs: misfit(moved(logs)), own, method="Nelder-Mead", options=options).x
    if robot.prismatic[at[0]]:
        # The weight of what slides does not depend on its position: nothing makes it more precise.
        return moved(own)

    def with_load(log: float) -> float:
        return misfit_as_modelled(robot, with_positions_times(reading, 1 / moved(own + log)))

    return moved(own + float(np.asarray(fminbound(with_load, -3 * step, 3 * step, xtol=5e-3))))


def _suspect(robot: Robot, joints: tuple[int, ...], ratios: Float[Array, " nv"]) -> Suspect:
    """The suspicion that positions of joints are those of their motors."""
    own = ratios[list(joints)]
    one = np.ptp(np.log(np.abs(own))) < _ONE_RATIO and len(set(np.sign(own))) == 1
    if one:
        ratios = ratios.copy()
        ratios[list(joints)] = float(np.sign(own[0]) * np.exp(np.mean(np.log(np.abs(own)))))
        own = ratios[list(joints)][:1]
    way = [", which turns the other way round" if ratio < 0 else "" for ratio in own]
    unit = " rad/m" if robot.prismatic[joints[0]] else ""
    said = [f"{abs(ratio):.3g}{unit}{back}" for ratio, back in zip(own, way, strict=True)]
    be = "position of {} is" if len(joints) == 1 else "positions of {} are"
    gear = "a gear" if one else "gears"
    return Suspect(
        "degrees" if not robot.prismatic[joints[0]] else "length",
        joints,
        f"the {be.format(names(robot, joints))} on the motor's side of {gear} of about {', '.join(said)}",
        position_entries(
            robot, {j: f"gear: {abs(ratios[j]):.3g}{', sign: -1' if ratios[j] < 0 else ''}" for j in joints}
        ),
        lambda reading: with_positions_times(reading, 1 / ratios),
        moves=True,
        turned=not robot.prismatic[joints[0]],
        # Without weight only the inertia distinguishes a screw from another unit.
        price=0 if robot.prismatic[joints[0]] else 1,
    )
