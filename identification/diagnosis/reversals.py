"""Doubt about samples at which modelled friction changes sign: how it does so is not known.

A law says that friction jumps when the velocity changes sign. A real joint sticks for some milliseconds, or bends
before it slides, so that friction passes through zero earlier or later. Where noise is small, what that leaves looks
like torque that comes too late, and nothing else in a recording says so.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from phantom_dyn.dynamics import modelled_friction
from phantom_dyn.effects.operation import Operation

Array = np.ndarray

# Standard deviation of the time at which friction changes sign [s].
_WHEN = 0.005


def reversal_doubt(operation: Operation) -> Float[Array, "N nv"]:
    """By how much the torque of a model may be off, one standard deviation: the rate of its Coulomb friction in time.

    It has the sign of the change, so that filters make of it what they make of the torque.
    """
    friction = operation.own_friction
    # Viscous friction doubles with the velocity, Coulomb friction does not.
    coulomb = 2.0 * friction - modelled_friction(operation.robot, replace(operation, v=2.0 * operation.v))
    return _WHEN * np.gradient(coulomb, operation.dt, axis=0)
