"""Motion and torque of a recording as the laws of effects look at them: with the given model, and with the findings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identification.diagnosis.rest import standing_still
from identification.diagnosis.terms import FoundEffect, KnownEffect
from identification.log import Log
from phantom_dyn.dynamics import inverse_dynamics
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.operation import Operation
from phantom_dyn.motion import Motion
from phantom_dyn.robot import Robot


def operate(robot: Robot, log: Log, known: tuple[KnownEffect, ...], recording: int = 0) -> Operation:
    """Motion of a log with the torque of the given model; ``recording`` says which of several it is."""
    # The noise of a joint that is held has a sign, which friction would follow, and an acceleration, which couples.
    moves = ~standing_still(log).all(axis=0)
    motion = Motion(log.motion.t, log.motion.q, log.motion.v * moves, log.motion.a * moves)
    tau = inverse_dynamics(robot, motion)
    # What pushes from outside, the drive need not give.
    tau = tau if log.external is None else tau - log.external
    plain = Operation(motion.t, motion.q, motion.v, motion.a, robot, tau, tau, log.tau, recording=recording)
    for effect in known:
        # The drive has to give what the model needs less what the effect gives.
        tau = tau - effect_named(effect.effect).torque(robot, plain, effect.joint, np.array(effect.theta))
    return replace(plain, tau=tau, expected=tau) if known else plain


def expecting(robot: Robot, operation: Operation, found: tuple[FoundEffect, ...]) -> Operation:
    """The same operation with the torque of the effects that the last fit found."""
    plain = operation.again(operation.tau)
    expected = operation.tau
    for point in found:
        if not point.effect.follows_torque and point.effect.name != "torque_constant":
            signature = point.effect.signature(robot, plain, point.joint, point.shape)
            expected = expected.copy()
            expected[:, list(signature.rows)] += signature.columns @ point.coefficients
    return plain.again(expected)
