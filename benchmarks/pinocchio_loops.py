# pyright: reportAttributeAccessIssue=false
"""Compute rigid-body quantities of N samples with Python loops over Pinocchio.

The compiled loops of `phantom_dyn._kernels.rigid_body` are compared with these: their speed in the benchmarks, their
results in their tests.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from phantom_dyn.array_types import Array


def regressor(model: pin.Model, q: Array, v: Array, a: Array) -> Array:
    """Rigid-body torque regressor of the tree, all columns, shape ``(N, nt, 10 (njoints - 1))``."""
    data, p = model.createData(), 10 * (model.njoints - 1)
    out = np.empty((*v.shape, p))
    for k in range(len(q)):
        # Pinocchio returns a 1-D array for a robot with one joint.
        out[k] = pin.computeJointTorqueRegressor(model, data, q[k], v[k], a[k]).reshape(model.nv, p)
    return out


def torque(model: pin.Model, q: Array, v: Array, a: Array) -> Array:
    """Torque of the tree with armature, shape ``(N, nt)`` [N m or N]."""
    data, out = model.createData(), np.empty(v.shape)
    for k in range(len(q)):
        out[k] = pin.rnea(model, data, q[k], v[k], a[k])
    return out


def torque_slopes(model: pin.Model, q: Array, v: Array, a: Array) -> Array:
    """Derivative of the torque of joint i by position (then velocity) of joint j, ``[0 or 1, j, i, sample]``."""
    data, out = model.createData(), np.empty((2, model.nv, model.nv, len(q)))
    for k in range(len(q)):
        pin.computeRNEADerivatives(model, data, q[k], v[k], a[k])
        out[0, :, :, k], out[1, :, :, k] = data.dtau_dq.T, data.dtau_dv.T
    return out


def weight(model: pin.Model, q: Array, gravity: Array) -> Array:
    """Torque that holds the tree against gravity [m/s^2 in the root frame], shape ``(N, nt)`` [N m or N]."""
    turned = model.copy()
    turned.gravity = pin.Motion(np.asarray(gravity, dtype=float), np.zeros(3))
    data, out = turned.createData(), np.empty((len(q), model.nv))
    for k in range(len(q)):
        out[k] = pin.computeGeneralizedGravity(turned, data, q[k])
    return out


def mass(model: pin.Model, q: Array) -> Array:
    """Mass matrix of the tree with armature, shape ``(N, nt, nt)``.

    Pinocchio needs the joints of every branch in consecutive order, as its own readers of robot files create them.
    """
    data, out = model.createData(), np.empty((len(q), model.nv, model.nv))
    for k in range(len(q)):
        out[k] = pin.crba(model, data, q[k])
    # Pinocchio fills only the upper triangle.
    lower = np.tril_indices(model.nv, -1)
    out[:, lower[0], lower[1]] = out[:, lower[1], lower[0]]
    return out


def frame_pose(model: pin.Model, q: Array, frame: int) -> tuple[Array, Array]:
    """Orientation ``(N, 3, 3)`` and position ``(N, 3)`` [m] of a frame in the root frame."""
    data, rotation, position = model.createData(), np.empty((len(q), 3, 3)), np.empty((len(q), 3))
    for k in range(len(q)):
        pin.forwardKinematics(model, data, q[k])
        placement = pin.updateFramePlacement(model, data, frame)
        rotation[k], position[k] = placement.rotation, placement.translation
    return rotation, position


def frame_jacobian(model: pin.Model, q: Array, frame: int, body: bool) -> Array:
    """Jacobian of a frame in its own axes or in those of the root, rows v, then w, shape ``(N, 6, nt)``."""
    data, out = model.createData(), np.empty((len(q), 6, model.nv))
    reference = pin.LOCAL if body else pin.LOCAL_WORLD_ALIGNED
    for k in range(len(q)):
        out[k] = pin.computeFrameJacobian(model, data, q[k], frame, reference).reshape(6, model.nv)
    return out
