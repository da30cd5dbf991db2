"""Torque that Pinocchio says a model needs, the oracle of what loads and rotors add."""

import numpy as np
import pinocchio as pin

from phantom_dyn.effects.operation import Operation


def pinocchio_torque(model: pin.Model, operation: Operation) -> np.ndarray:
    """Inverse dynamics of a model at every state of an operation, armature included."""
    data = model.createData()
    states = zip(operation.q, operation.v, operation.a, strict=True)
    return np.array([pin.rnea(model, data, *state) for state in states])
