# pyright: reportAttributeAccessIssue=false
"""Torque, regressor, mass matrix and frames of a Pinocchio model for N samples, by compiled loops.

Arguments of the functions: ``arrays`` are the `tree_arrays` of the model; gravity and armature are read from the model
at every call. ``q`` are Pinocchio's configurations, ``(N, nq)``; ``v`` and ``a`` have shape ``(N, nt)``. ``root`` is
the motion of the root, ``(N, 9)``, see `torque_loop`, or None for a fixed root; the specific force of a moving root
replaces gravity. All functions raise `LogError` for samples whose shapes do not fit the robot.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin

from phantom_dyn._kernels.regressor_loop import NONE, SCATTERED, body_workspace, regressor_loop
from phantom_dyn._kernels.rigid_body_loops import Frame, FramePoses, frame_loop, mass_loop, torque_loop, workspace_of
from phantom_dyn._kernels.torque_slope_loop import slope_workspace_of, torque_slope_loop
from phantom_dyn._kernels.tree_arrays import TreeArrays
from phantom_dyn.array_types import Array
from phantom_dyn.errors import LogError, ParameterError

# Smallest number of samples for which the compiled loop of torque derivatives is used. For fewer samples Pinocchio's
# function finishes before the loop would be compiled.
_WORTH_COMPILING = 20_000
# Motion of a fixed root: no samples.
_FIXED = np.empty((0, 9))


def regressor(
    model: pin.Model,
    arrays: TreeArrays,
    q: Array,
    v: Array,
    a: Array,
    *,
    root: Array | None = None,
    slope: Array | None = None,
    columns: tuple[int, ...] | None = None,
    out: Array | None = None,
) -> Array:
    """Rigid-body torque regressor.

    Args:
        model: The robot; its gravity is used.
        arrays: The tree of joints as arrays.
        q: Pinocchio's configurations, ``(N, nq)``.
        v: Velocities of the tree, ``(N, nt)``.
        a: Accelerations of the tree, ``(N, nt)``.
        root: Motion of the root, ``(N, 9)``, see `torque_loop`; None if it is fixed.
        slope: Velocities of the tree per velocity of the active joints of a closed chain, ``G``, ``(N, nt, nv)``; the
            regressor then has rows for the active joints only. None for a robot without loops.
        columns: Columns to compute, ascending; by default all ten of each joint.
        out: C-contiguous array into whose first columns the result is written, ``(N, nv, c)`` with ``c`` at least the
            number of columns. It must be zero, or hold the result of the same call for other samples.

    Returns:
        Shape ``(N, nv, number of columns)``, or ``out``.

    Raises:
        LogError: If the shapes of the motion do not fit the robot.
        ParameterError: If a column does not exist, columns do not ascend, or ``slope`` or ``out`` has a wrong shape.
    """
    _require_motion(model, q, v, a, root=root)
    if slope is not None and slope.shape[:2] != v.shape:
        raise ParameterError(f"slope has shape {slope.shape}: give {v.shape[1]} rows for each of {len(v)} samples.")
    p = 10 * (model.njoints - 1)
    wanted = np.arange(p) if columns is None else np.asarray(columns).reshape(-1)
    integer = len(wanted) == 0 or np.issubdtype(wanted.dtype, np.integer)
    chosen = wanted.astype(np.int64)
    if not integer or (len(chosen) and (chosen[0] < 0 or chosen[-1] >= p or (np.diff(chosen) <= 0).any())):
        raise ParameterError(f"columns is {columns}: give ascending column numbers from 0 to {p - 1}.")
    rows = v.shape[1] if slope is None else slope.shape[2]
    if out is None:
        # The loop does not write entries that are always zero.
        out = np.zeros((len(q), rows, len(chosen)))
    else:
        _require_shape(out, (len(q), rows, len(chosen)))
    places = np.full(p, -1)
    places[chosen] = np.arange(len(chosen))
    G = np.empty((0, *v.shape[1:], rows)) if slope is None else slope
    # A stride of zero means that all samples share one matrix in memory.
    G = G[:1] if len(G) and G.strides[0] == 0 else G
    samples = _rooted(root), ready(q), ready(v), ready(a), ready(G)
    announce(regressor_loop)
    tree = arrays.kinematics
    workspaces = workspace_of(tree, model.gravity.linear), body_workspace(tree)
    regressor_loop(tree, *workspaces, *samples, _with_first(places.reshape(-1, 10)), out)
    return out


def _with_first(places: Array) -> Array:
    """Argument ``places`` of `regressor_loop`, from the columns of the ten parameters of each body."""
    count = (places >= 0).sum(axis=1)
    contiguous = (count == 10) & (places[:, 9] == places[:, 0] + 9)
    first = np.where(contiguous, places[:, 0], np.where(count > 0, SCATTERED, NONE))
    return ready(np.column_stack([first, places]), np.int64)


def _rooted(root: Array | None) -> Array:
    """Motion of the root, in the form that the loops take."""
    return ready(_FIXED if root is None else root)


def _require_motion(model: pin.Model, q: Array, *rates: Array, root: Array | None = None) -> None:
    """Refuse samples whose shapes do not fit the robot, because a compiled loop would read beyond their end."""
    if root is not None and root.shape != (len(q), 9):
        raise LogError(f"The root's motion has shape {root.shape}: give nine numbers for each of {len(q)} samples.")
    if q.ndim != 2 or q.shape[1] != model.nq or any(rate.shape != (len(q), model.nv) for rate in rates):
        given = ", ".join(str(x.shape) for x in (q, *rates))
        raise LogError(
            f"Samples of shape {given} do not fit a robot of {model.nq} configuration entries and {model.nv} "
            f"velocities: give one row per sample and one column for each."
        )


def _require_shape(out: Array, wanted: tuple[int, int, int]) -> None:
    """Refuse an array into which the result cannot be written."""
    fits = out.ndim == 3 and out.shape[:2] == wanted[:2] and out.shape[2] >= wanted[2]
    if not (fits and out.dtype == np.float64 and out.flags.c_contiguous and out.flags.writeable):
        raise ParameterError(
            f"out has shape {out.shape} and type {out.dtype}: give a C-contiguous array of floats that can be written, "
            f"of shape {wanted} or with more columns."
        )


def torque(model: pin.Model, arrays: TreeArrays, q: Array, v: Array, a: Array, root: Array | None = None) -> Array:
    """Torque with armature, as `pin.rnea`, shape ``(N, nt)`` [N m or N]."""
    _require_motion(model, q, v, a, root=root)
    return _torque(arrays, model.gravity.linear, q, v, a, root) + model.armature * a


def weight(model: pin.Model, arrays: TreeArrays, q: Array, gravity: Array | None = None) -> Array:
    """Torque that holds all bodies against gravity, ``(N, nt)``; ``gravity`` [m/s2] is in the root frame."""
    _require_motion(model, q)
    pull = model.gravity.linear if gravity is None else np.asarray(gravity, dtype=float)
    if pull.shape != (3,):
        raise ParameterError(f"gravity has shape {pull.shape}: give three components [m/s^2].")
    rest = np.zeros((len(q), model.nv))
    return _torque(arrays, pull, q, rest, rest)


def _torque(arrays: TreeArrays, gravity: Array, q: Array, v: Array, a: Array, root: Array | None = None) -> Array:
    out = np.empty(v.shape)
    announce(torque_loop)
    workspace = workspace_of(arrays.kinematics, gravity)
    torque_loop(arrays.kinematics, arrays.inertias, workspace, _rooted(root), ready(q), ready(v), ready(a), out)
    return out


def torque_slopes(
    model: pin.Model, arrays: TreeArrays, q: Array, v: Array, a: Array, root: Array | None = None
) -> tuple[Array, Array]:
    """Derivatives of the torque of joint i by position and by velocity of joint j, two arrays ``(N, nt, nt)``.

    Entries are ``[sample, i, j]``; in memory the samples of an entry are contiguous.
    """
    _require_motion(model, q, v, a, root=root)
    if len(q) < _WORTH_COMPILING:
        out = _slopes_by_pinocchio(model, q, v, a, root)
    else:
        out = np.zeros((2, model.nv, model.nv, len(q)))
        announce(torque_slope_loop)
        tree, gravity = arrays.kinematics, model.gravity.linear
        workspaces = workspace_of(tree, gravity), slope_workspace_of(tree, gravity)
        torque_slope_loop(tree, arrays.inertias, *workspaces, _rooted(root), ready(q), ready(v), ready(a), out)
    return out[0].transpose(2, 1, 0), out[1].transpose(2, 1, 0)


def _slopes_by_pinocchio(model: pin.Model, q: Array, v: Array, a: Array, root: Array | None = None) -> Array:
    """Derivatives of the torque of joint i by position (0) and velocity (1) of joint j, ``[0 or 1, j, i, sample]``."""
    if root is not None:
        whole, samples = _on_moving_root(model, q, v, a, root)
        return _slopes_by_pinocchio(whole, *samples)[:, 6:, 6:]
    data, out = model.createData(), np.empty((2, model.nv, model.nv, len(q)))
    for k in range(len(q)):
        pin.computeRNEADerivatives(model, data, q[k], v[k], a[k])
        out[0, :, :, k], out[1, :, :, k] = data.dtau_dq.T, data.dtau_dv.T
    return out


def _on_moving_root(model: pin.Model, q: Array, v: Array, a: Array, root: Array) -> tuple[pin.Model, tuple[Array, ...]]:
    """The tree on a free-flyer without gravity, and its samples: the specific force accelerates the root."""
    base = pin.Model()
    joint = base.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "moving root")
    base.addJointFrame(joint, 0)
    whole = pin.appendModel(base, model, base.getFrameId("moving root"), pin.SE3.Identity())
    whole.gravity = pin.Motion.Zero()
    n, still = len(q), np.zeros((len(q), 3))
    place = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (n, 1))
    w, dw, force = root[:, :3], root[:, 3:6], root[:, 6:]
    return whole, (np.hstack([place, q]), np.hstack([still, w, v]), np.hstack([force, dw, a]))


def mass(model: pin.Model, arrays: TreeArrays, q: Array) -> Array:
    """Mass matrix with armature, as `pin.crba` with both triangles, shape ``(N, nt, nt)``."""
    _require_motion(model, q)
    out = np.zeros((len(q), model.nv, model.nv))
    announce(mass_loop)
    mass_loop(arrays.kinematics, arrays.inertias, workspace_of(arrays.kinematics, np.zeros(3)), ready(q), out)
    diagonal = np.arange(model.nv)
    out[:, diagonal, diagonal] += model.armature
    return out


def frame_pose(model: pin.Model, arrays: TreeArrays, q: Array, frame: int) -> tuple[Array, Array]:
    """Orientation ``(N, 3, 3)`` and position ``(N, 3)`` [m] of a frame, by its index, in the root frame."""
    _require_motion(model, q)
    return _frame(model, arrays, q, frame, body=False, jacobian=False)[:2]


def frame(model: pin.Model, arrays: TreeArrays, q: Array, index: int) -> tuple[Array, Array, Array]:
    """Orientation, position [m] and Jacobian of a frame in the axes of the root, see `frame_pose`."""
    _require_motion(model, q)
    return _frame(model, arrays, q, index, body=False, jacobian=True)


def frame_jacobian(model: pin.Model, arrays: TreeArrays, q: Array, frame: int, *, body: bool) -> Array:
    """Jacobian of a frame, rows v, then w, ``(N, 6, nt)``: in the frame's axes if ``body``, else in the root's."""
    _require_motion(model, q)
    return _frame(model, arrays, q, frame, body=body, jacobian=True)[2]


def _frame(model: pin.Model, arrays: TreeArrays, q: Array, frame: int, *, body: bool, jacobian: bool) -> FramePoses:
    placed = model.frames[frame].placement
    given = Frame(model.frames[frame].parentJoint, ready(placed.rotation), ready(placed.translation))
    out = FramePoses(
        np.empty((len(q), 3, 3)), np.empty((len(q), 3)), np.zeros((len(q) if jacobian else 0, 6, model.nv))
    )
    announce(frame_loop)
    frame_loop(arrays.kinematics, workspace_of(arrays.kinematics, np.zeros(3)), ready(q), given, body, out)
    return out


def ready(array: Array, kind: type = np.float64) -> Array:
    """The array, made contiguous, read-only and of type ``kind``; numba would compile the loop again for any other."""
    if array.dtype == kind and array.flags.c_contiguous and not array.flags.writeable:
        return array
    view = np.ascontiguousarray(array, dtype=kind).view()
    view.flags.writeable = False
    return view


def announce(loop: Callable[..., Any]) -> None:
    """Log that a loop has to be compiled, if this is its first use in the process."""
    if not getattr(loop, "signatures", True):
        logging.getLogger("phantom_dyn").info(
            "Preparing compiled loops over samples: some seconds at the first use, read from disk later."
        )
