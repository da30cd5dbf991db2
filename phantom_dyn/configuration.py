# pyright: reportAttributeAccessIssue=false
"""Joint positions, one number per joint, as Pinocchio's configuration vectors."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from jaxtyping import Float

Array = np.ndarray


def configurations(model: pin.Model, positions: Float[Array, "N nt"]) -> Float[Array, "N nq"]:
    """Configurations of a model at the positions of its joints [rad or m]; a continuous joint becomes cos, sin."""
    if model.nq == model.nv:
        return positions
    out = np.empty((len(positions), model.nq))
    for joint in model.joints[1:]:
        column = positions[:, joint.idx_v]
        if joint.nq == 2:
            out[:, joint.idx_q], out[:, joint.idx_q + 1] = np.cos(column), np.sin(column)
        else:
            out[:, joint.idx_q] = column
    return out
