"""Coulomb friction in one step of a simulation, by projected Gauss-Seidel sweeps over the joint velocities.

The friction torque of a joint is the one that stops the joint within the step, clipped to its limit. So a joint at rest
stays exactly at rest as long as the limit suffices.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from phantom_dyn._kernels.jit import inlined_jit, jit
from phantom_dyn.array_types import Array

# Largest number of sweeps.
_SWEEPS = 200
# The sweeps end when no torque changes by more than this share of its limit.
_CONVERGED = 1e-10


class FrictionPlaces(NamedTuple):
    """Motors and passive joints with dry friction; ``n`` is the number of velocities.

    Attributes:
        motors: Index of each motor among the velocities, ``(m,)``.
        passive: Velocity of each passive joint per velocity of the mechanism (Jacobian), ``(p, n)``.
        response: Work array, ``(p, n + 1)``: the change of all velocities by a unit impulse on each passive joint
            and, in the last column, the velocity of this joint.
    """

    motors: Array
    passive: Array
    response: Array


def friction_on_motors(places: Array, n: int) -> FrictionPlaces:
    """Friction on the motors at these indices among ``n`` velocities, without passive joints."""
    return FrictionPlaces(np.asarray(places, dtype=np.int64), np.zeros((0, n)), np.zeros((0, n + 1)))


@jit
def apply_dry_friction(
    mobility: Array, speed: Array, places: FrictionPlaces, friction: Array, limits: Array, h: float
) -> None:
    """Add the Coulomb friction of motors and passive joints to the velocities, in place.

    Args:
        mobility: Velocity per impulse, symmetric, ``(n, n)``.
        speed: Velocities without friction, ``(n,)``; overwritten by those with friction.
        places: Where friction acts; its work array is overwritten.
        friction: First guess of the friction torques, motors before passive joints, ``(m + p,)``; overwritten by the
            torques of this step.
        limits: Largest friction torques, ``(m + p,)``; zero for joints without friction.
        h: Length of the step [s].
    """
    start_search(mobility, speed, places, friction, limits, h)
    for _ in range(_SWEEPS):
        largest = sweep_motors(mobility, speed, places, friction, limits, h)
        largest = max(largest, sweep_passive(speed, places, friction, limits, h))
        if largest <= _CONVERGED:
            break
    # A motor that friction holds is exactly at rest.
    for j in range(len(places.motors)):
        if abs(friction[j]) < limits[j]:
            speed[places.motors[j]] = 0.0


@inlined_jit
def start_search(
    mobility: Array, speed: Array, places: FrictionPlaces, friction: Array, limits: Array, h: float
) -> None:
    """Write the responses to impulses on passive joints, and add the torques of the first guess to the velocities."""
    n, m = len(speed), len(places.motors)
    motors, passive, response = places.motors, places.passive, places.response
    for j in range(m):
        if limits[j] > 0.0:
            impulse = h * friction[j]
            for i in range(n):
                speed[i] += mobility[i, motors[j]] * impulse
    for e in range(len(passive)):
        if limits[m + e] > 0.0:
            response[e, n] = 0.0
            for i in range(n):
                response[e, i] = 0.0
                for k in range(n):
                    response[e, i] += mobility[i, k] * passive[e, k]
            for i in range(n):
                response[e, n] += passive[e, i] * response[e, i]
                speed[i] += response[e, i] * (h * friction[m + e])


@inlined_jit
def sweep_motors(
    mobility: Array, speed: Array, places: FrictionPlaces, friction: Array, limits: Array, h: float
) -> float:
    """Correct the torques on motors one by one; returns the largest change relative to a torque's limit."""
    largest = 0.0
    for j in range(len(places.motors)):
        if limits[j] > 0.0:
            motor = places.motors[j]
            wanted = min(max(friction[j] - speed[motor] / (mobility[motor, motor] * h), -limits[j]), limits[j])
            change = wanted - friction[j]
            if change != 0.0:
                for i in range(len(speed)):
                    speed[i] += mobility[i, motor] * (change * h)
                friction[j] = wanted
                largest = max(largest, abs(change) / limits[j])
    return largest


@inlined_jit
def sweep_passive(speed: Array, places: FrictionPlaces, friction: Array, limits: Array, h: float) -> float:
    """Correct the torques on passive joints one by one; returns the largest change relative to a torque's limit."""
    n, m, largest = len(speed), len(places.motors), 0.0
    for e in range(len(places.passive)):
        limit, rate = limits[m + e], 0.0
        if limit > 0.0:
            for i in range(n):
                rate += places.passive[e, i] * speed[i]
            wanted = min(max(friction[m + e] - rate / (places.response[e, n] * h), -limit), limit)
            change = wanted - friction[m + e]
            if change != 0.0:
                for i in range(n):
                    speed[i] += places.response[e, i] * (change * h)
                friction[m + e] = wanted
                largest = max(largest, abs(change) / limit)
    return largest
