# pyright: reportAttributeAccessIssue=false
"""Where frames are and how far bodies are apart, with slopes in the joint positions."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from identification.excitation.collisions import distances
from identification.excitation.limits import Limits

Array = np.ndarray


def places(
    model: pin.Model, limits: Limits, configuration: Float[Array, "N nq"], *, slopes: bool
) -> tuple[Float[Array, "N m"], Float[Array, "N m nt"] | None]:
    """Coordinates [m] of the frames that have a box, then the distance [m] of each pair that must not collide.

    Args:
        model: The tree.
        limits: Names frames and pairs.
        configuration: Pinocchio's, N samples.
        slopes: True if the slope is wanted too, else None.

    Returns:
        Values, and their slope in the joint velocities of the tree.
    """
    frames = [model.getFrameId(box.frame) for box in limits.boxes]
    values = np.empty((len(configuration), 3 * len(frames)))
    slope = np.empty((*values.shape, model.nv)) if slopes else None
    data = model.createData()
    for k, q in enumerate(configuration if frames else ()):
        if slopes:
            pin.computeJointJacobians(model, data, q)
        else:
            pin.forwardKinematics(model, data, q)
        for m, frame in enumerate(frames):
            values[k, 3 * m : 3 * m + 3] = pin.updateFramePlacement(model, data, frame).translation
            if slope is not None:
                J = pin.getFrameJacobian(model, data, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
                slope[k, 3 * m : 3 * m + 3] = J[:3]
    if limits.collisions is None or not len(limits.collisions.names):
        return values, slope
    apart, apart_slope = distances(model, limits.collisions, configuration, slopes=slopes)
    if slope is None or apart_slope is None:
        return np.concatenate([values, apart], axis=1), None
    return np.concatenate([values, apart], axis=1), np.concatenate([slope, apart_slope], axis=1)
