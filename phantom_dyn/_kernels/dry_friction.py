"""Dry friction as impulses, each of which stops its joint if it can and else opposes it, for all simulations.

Projected Gauss-Seidel sweeps over the torques within their limits, on velocity level, so that a joint at rest stays at
rest.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from phantom_dyn._kernels.jit import jit, within
from phantom_dyn.array_types import Array

_SWEEPS = 200
"""Sweeps at most; they stop when no torque moves by more than `_STILL` of its limit."""
_STILL = 1e-10


class Rubbing(NamedTuple):
    """Where dry friction acts: motors, and passive joints that turn with them; ``n`` is the number of velocities.

    Attributes:
        motors: Place of each motor among the velocities, ``(m,)``.
        passive: How fast each passive joint turns per velocity, ``(p, n)``.
        reply: Room for what an impulse on each passive joint does to all velocities and to its own, ``(p, n + 1)``.
    """

    motors: Array
    passive: Array
    reply: Array


def rubbing_motors(places: Array, n: int) -> Rubbing:
    """Motors at these places among ``n`` velocities, and nothing else that rubs."""
    return Rubbing(np.asarray(places, dtype=np.int64), np.zeros((0, n)), np.zeros((0, n + 1)))


@jit
def rub(mobility: Array, speed: Array, who: Rubbing, friction: Array, most: Array, h: float) -> None:
    """Coulomb friction of at most ``most`` on motors and passive joints.

    Args:
        mobility: Velocity per impulse, symmetric, ``(n, n)``.
        speed: Velocities without friction, ``(n,)``; with it afterwards.
        who: Where friction acts; its room is overwritten.
        friction: Torque with which the search begins, of motors, then of passive joints, ``(m + p,)``; that of this
            step afterwards.
        most: Limits of the torque, ``(m + p,)``; none where it is zero.
        h: Length of the step [s].
    """
    begin(mobility, speed, who, friction, most, h)
    for _ in range(_SWEEPS):
        largest = motors_moved(mobility, speed, who, friction, most, h)
        largest = max(largest, passive_moved(speed, who, friction, most, h))
        if largest <= _STILL:
            break
    # A motor that friction holds is at rest, not almost.
    for j in range(len(who.motors)):
        if abs(friction[j]) < most[j]:
            speed[who.motors[j]] = 0.0


@within
def begin(mobility: Array, speed: Array, who: Rubbing, friction: Array, most: Array, h: float) -> None:
    """Write what impulses on passive joints do, and add the impulses with which the search begins."""
    n, m = len(speed), len(who.motors)
    motors, passive, reply = who.motors, who.passive, who.reply
    for j in range(m):
        if most[j] > 0.0:
            impulse = h * friction[j]
            for i in range(n):
                speed[i] += mobility[i, motors[j]] * impulse
    for e in range(len(passive)):
        if most[m + e] > 0.0:
            reply[e, n] = 0.0
            for i in range(n):
                reply[e, i] = 0.0
                for k in range(n):
                    reply[e, i] += mobility[i, k] * passive[e, k]
            for i in range(n):
                reply[e, n] += passive[e, i] * reply[e, i]
                speed[i] += reply[e, i] * (h * friction[m + e])


@within
def motors_moved(mobility: Array, speed: Array, who: Rubbing, friction: Array, most: Array, h: float) -> float:
    """Sweep over the motors; the largest change of a torque over its limit."""
    largest = 0.0
    for j in range(len(who.motors)):
        if most[j] > 0.0:
            at = who.motors[j]
            wanted = min(max(friction[j] - speed[at] / (mobility[at, at] * h), -most[j]), most[j])
            change = wanted - friction[j]
            if change != 0.0:
                for i in range(len(speed)):
                    speed[i] += mobility[i, at] * (change * h)
                friction[j] = wanted
                largest = max(largest, abs(change) / most[j])
    return largest


@within
def passive_moved(speed: Array, who: Rubbing, friction: Array, most: Array, h: float) -> float:
    """Sweep over the passive joints; the largest change of a torque over its limit."""
    n, m, largest = len(speed), len(who.motors), 0.0
    for e in range(len(who.passive)):
        limit, rate = most[m + e], 0.0
        if limit > 0.0:
            for i in range(n):
                rate += who.passive[e, i] * speed[i]
            wanted = min(max(friction[m + e] - rate / (who.reply[e, n] * h), -limit), limit)
            change = wanted - friction[m + e]
            if change != 0.0:
                for i in range(n):
                    speed[i] += who.reply[e, i] * (change * h)
                friction[m + e] = wanted
                largest = max(largest, abs(change) / limit)
    return largest
