"""Replaces the torque of a joint by the model's torque while a brake holds it.

Many robots close a brake at the end of a move and switch the drive off. The drive then gives no torque, although the
joint bears weight. Such rests are not used, but the filter spreads the step of the torque at their ends over samples in
motion, where it looks like a push.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identification.data.log import Log
from identification.diagnosis.columns.motion.standstill import standing_still
from phantom_dyn.array_types import Array, Bool
from phantom_dyn.dynamics.dynamics import inverse_dynamics, modelled_friction
from phantom_dyn.model.robot import Robot

# Shortest rest [s] on a brake.
_LEAST_REST = 0.5
# Shares of the weight. A drive whose torque in a rest is below the first share gives no torque. A drive whose torque in
# motion is above the second share bears the weight.
_NOTHING, _BEARS = 0.05, 0.5
# The weight has to exceed this share of the root mean square torque in motion, so that friction can hardly hold it.
_LARGE = 0.5
# Share of the top speed below which a smoothed joint may still be held.
_SLOW = 0.05


def with_brakes(robot: Robot, log: Log) -> Log:
    """The log, with the model's torque in each rest in which the drive bears no weight, although it bears it in motion.

    `Log.braked` names the joints with such rests.
    """
    weight = inverse_dynamics(robot, log.motion) - modelled_friction(robot, log.motion)
    still, tau, braked = standing_still(log), log.tau.copy(), dict[str, None]()
    for j in range(robot.nv):
        moves = ~still[:, j]
        borne = log.tau[moves, j] @ weight[moves, j]
        # If the drive bears no weight in motion either, its rests show no brake.
        if borne <= _BEARS * (weight[moves, j] @ weight[moves, j]):
            continue
        usual = float(np.sqrt(np.mean(log.tau[moves, j] ** 2)))
        speed = np.abs(log.motion.v[:, j])
        slow = speed < _SLOW * np.percentile(speed, 99)
        ends = np.flatnonzero(np.diff(still[:, j].astype(int), prepend=0, append=0))
        for rest in (slice(int(start), int(stop)) for start, stop in ends.reshape(-1, 2)):
            given, needed = np.median(log.tau[rest, j]), np.median(weight[rest, j])
            long = rest.stop - rest.start >= _LEAST_REST * log.band.rate_hz
            too_heavy = abs(needed) > max(robot.coulomb_friction[j], _LARGE * usual)
            if long and too_heavy and abs(given) < _NOTHING * abs(needed):
                held = _around(rest, slow & (np.abs(log.tau[:, j]) < _BEARS * np.abs(weight[:, j])))
                tau[held, j] = weight[held, j]
                braked[log.joint_names[j]] = None
    return replace(log, tau=tau, braked=tuple(braked))


def _around(rest: slice, unborne: Bool[Array, " N"]) -> slice:
    """The longest run of samples around the middle of a rest in which the drive does not bear the weight."""
    bearing, middle = np.flatnonzero(~unborne), (rest.start + rest.stop) // 2
    before, after = bearing[bearing < middle], bearing[bearing >= middle]
    first = int(before[-1]) + 1 if len(before) else 0
    return slice(first, int(after[0]) if len(after) else len(unborne))
