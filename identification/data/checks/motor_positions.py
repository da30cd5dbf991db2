"""Positions that are recorded on the motor's side of a gear of unknown ratio, found by what the links need.

Read so, a joint turns as many times as far as it does, perhaps the other way round. The ratio is the one with which the
model explains the torques of all joints best; the weight of the links fixes it, as it depends on the angle itself.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import fminbound

from identification.data.checks.readings.plausible_fit import ENOUGH
from identification.data.checks.readings.reading import Reading, with_positions_times
from identification.data.checks.readings.suspects import Suspect, names
from identification.data.checks.torques.scaled_model import plain_left
from identification.data.readers.map_entries import entries
from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import ChainError
from phantom_dyn.model.robot import Robot

# Ratios that are tried: those of robots' gears, in steps of four per cent, finer than the width of a minimum.
_RATIOS = np.geomspace(1.25, 500.0, 150)
# A ratio so near to 57.3 is that of degrees. Where more joints turn so far, one ratio of all is tried alone.
_DEGREES, _NEAR, _MOST_JOINTS = 180 / np.pi, 1.1, 3
# Angle [rad] below which a joint may turn as it says.
_FAR = 2 * np.pi


def motor_side_suspects(robot: Robot, reading: Reading) -> list[Suspect]:
    """The gear ratios by which positions of joints that turn more than once are best divided: all at once, and each.

    Args:
        robot: The given model.
        reading: The recorded data.
    """
    far = np.flatnonzero(~robot.prismatic & (np.abs(reading.motion.q).max(axis=0) > _FAR)).tolist()
    sets = [tuple(far)] if far else []
    if 1 < len(far) <= _MOST_JOINTS:
        sets += [(j,) for j in far]
    ratios = [(joints, _best_ratio(robot, reading, joints)) for joints in sets]
    return [_suspect(robot, joints, ratio) for joints, ratio in ratios if not 1 / _NEAR < ratio / _DEGREES < _NEAR]


def _best_ratio(robot: Robot, reading: Reading, joints: tuple[int, ...]) -> float:
    """The ratio, negative for motors that turn the other way round, with which torques fit the model best."""

    def misfit(ratio: float) -> float:
        """Sum of the logarithms of the unexplained shares of all joints' torques."""
        try:
            left = plain_left(robot, with_positions_times(reading, _divided(robot, joints, ratio)))
        except ChainError:
            return np.inf
        return float(np.nansum(np.log(left + ENOUGH)))

    _, sign, about = min((misfit(sign * ratio), sign, ratio) for ratio in _RATIOS for sign in (1, -1))
    step = _RATIOS[1] / _RATIOS[0]
    bounds = (float(np.log(about / step)), float(np.log(about * step)))
    best = fminbound(lambda log: misfit(sign * np.exp(log)), *bounds)
    return sign * float(np.exp(best))


def _divided(robot: Robot, joints: tuple[int, ...], ratio: float) -> Float[Array, " nv"]:
    """Factors of all positions that divide those of some joints by a gear ratio."""
    factor = np.ones(robot.nv)
    factor[list(joints)] = 1.0 / ratio
    return factor


def _suspect(robot: Robot, joints: tuple[int, ...], ratio: float) -> Suspect:
    """The suspicion that positions of joints are those of their motors."""
    back = ", sign: -1" if ratio < 0 else ""
    way = ", which turns the other way round" if ratio < 0 else ""
    factor = _divided(robot, joints, ratio)
    be = "position of {} is" if len(joints) == 1 else "positions of {} are"
    return Suspect(
        "degrees",
        joints,
        f"the {be.format(names(robot, joints))} on the motor's side of a gear of about {abs(ratio):.3g}{way}",
        entries(robot, "q", joints, f"gear: {abs(ratio):.3g}{back}"),
        lambda reading: with_positions_times(reading, factor),
        moves=True,
        turned=True,
    )
