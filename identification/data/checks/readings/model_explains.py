"""Finds mistakes after whose correction the given model explains a recording; as recorded, only another robot does.

A plausible robot explains the data as recorded, so `better_readings` finds no certain mistake. But the torque constants
and inertias of that robot differ from those of the model by exactly the factors that the mistake causes.
"""

from __future__ import annotations

import numpy as np

from identification.data.checks.readings.plausible_fit import AS_MODELLED, unexplained
from identification.data.checks.readings.reading import Reading
from identification.data.checks.readings.reading_fits import (
    FAR_BETTER,
    ReadingFit,
    explains_nearly_all,
    fit_of,
    is_certain,
    poorly_fitted,
)
from identification.data.checks.readings.suspects import Suspect, order_suspects
from identification.data.checks.readings.weights import compensated_suspects
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.errors import ChainError
from phantom_dyn.model.robot import Robot


def explained_by_the_model(robot: Robot, reading: Reading) -> list[ReadingFit]:
    """The mistakes after whose correction a robot like its model explains the data; empty if there are none.

    - The columns of two joints are exchanged. This mistake is certain if both joints fit far better.
    - A controller subtracted gravity from the torque, and the robot carries a load that the model lacks. Many robots
      carry such a load, so this mistake is reported as possible and not as certain.

    Args:
        robot: The given model.
        reading: The data as recorded.
    """
    before = unexplained(robot, reading, AS_MODELLED)

    def fits(suspects: list[Suspect]) -> list[ReadingFit]:
        tried = [fit_of(robot, before, reading, one, AS_MODELLED) for one in suspects]
        return [one for one in tried if is_certain(one) and explains_nearly_all(one)]

    exchanged = [
        one
        for one in fits(_exchanges(robot, reading, before))
        if np.all(one.joint_gains[list(one.suspect.joints)] >= FAR_BETTER)
    ]
    if exchanged:
        return [max(exchanged, key=lambda one: one.score)]
    return fits(compensated_suspects(robot, reading, loaded=True))


def _exchanges(robot: Robot, reading: Reading, before: Float[Array, "2 nv"]) -> list[Suspect]:
    """The exchanges of two joints that fit poorly, after which the given model is closer to the torque of both.

    Args:
        robot: The given model.
        reading: The data as recorded.
        before: Unexplained shares of the data as recorded, ``(2, nv)``.
    """
    poor = poorly_fitted(before)
    if len(poor) < 2:
        return []
    as_recorded = _residual_shares(robot, reading)
    out: list[Suspect] = []
    for one in order_suspects(robot, poor):
        joints = list(one.joints)
        if set(joints) <= set(poor) and np.all((_residual_shares(robot, one.read(reading)) < as_recorded)[joints]):
            out.append(one)
    return out


def _residual_shares(robot: Robot, reading: Reading) -> Float[Array, " nv"]:
    """Variance of each joint's torque minus the modelled torque, divided by that of its torque.

    All are infinite if the loops of a closed chain do not close at the positions of the reading.
    """
    torque = reading.tau + reading.external
    try:
        residual = torque - inverse_dynamics(robot, reading.motion)
    except ChainError:
        return np.full(robot.nv, np.inf)
    return residual.var(axis=0) / np.maximum(torque.var(axis=0), np.finfo(float).tiny)
