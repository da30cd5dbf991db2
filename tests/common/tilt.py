"""Recordings of the arm whose second joint is ``tilt``, with a torque put into them."""

import numpy as np

from phantom_dyn.effects.operation import Operation


def recorded(operation: Operation, torque: np.ndarray) -> Operation:
    """The recording of a drive that makes up for ``torque`` on the tilt joint."""
    logged = operation.tau.copy()
    logged[:, 1] -= torque
    return Operation.of(operation.robot, operation, logged)
