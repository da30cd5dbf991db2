# pyright: reportAttributeAccessIssue=false
"""Compiled code that closes the loops of a chain along a trajectory, and computes their effect on accelerations.

An anchor keeps two frames of the tree together. Newton's method finds the joint positions at which the distance between
the frames of every anchor is zero. If Newton's method fails, `phantom_dyn.loops.solver` finds the reason.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
import pinocchio as pin

from phantom_dyn._kernels.jit import fused, inlined
from phantom_dyn._kernels.poses import cross, move, place, turned, turned_back
from phantom_dyn._kernels.pseudo_inverse import pseudo_inverse
from phantom_dyn._kernels.tree_arrays import CONTINUOUS, Kinematics, TreeArrays
from phantom_dyn.array_types import Array

# Sine of an angle below which angle and sine are taken as equal.
_SMALLEST_SINE = 1e-9


class AnchoredTree(NamedTuple):
    """A tree of joints and the ``k`` anchors that close its loops.

    Attributes:
        kinematics: The joints.
        joints: The joint that carries the first frame, the joint that carries the second one, and 1 if the axes of the
            frames stay together too, ``(k, 3)``.
        frames: Pose of each frame in the joint that carries it: three rows of the rotation, then the origin [m],
            ``(k, 2, 4, 3)``.
    """

    kinematics: Kinematics
    joints: Array
    frames: Array


class Limits(NamedTuple):
    """Limits at which Newton's method and the steps from sample to sample stop.

    Attributes:
        closed: Largest distance [m, rad] between two frames that count as coincident.
        singular: Ratio of smallest to largest singular value below which the unknowns are not determined.
        last_step: Newton's method ends when no unknown moves by more than this [rad or m].
        reach: Longest step of a joint between two solutions [rad or m].
        correction: Largest change of a predicted solution by Newton's method, relative to the length of the step.
        shortest: Smallest share of the distance to the next sample that is tried as one step.
        iterations: Largest number of iterations of Newton's method.
    """

    closed: float
    singular: float
    last_step: float
    reach: float
    correction: float
    shortest: float
    iterations: int


class Closed(NamedTuple):
    """Solutions of N samples, and one additional row for the start.

    Attributes:
        z: The unknowns, which are the positions of joints that only the loops determine, ``(N + 1, nz)``.
        slopes: Derivatives of the unknowns by the active positions, ``(N + 1, nz, nv)``.
        inverses: Inverses of the derivative of the constraints by the unknowns, ``(N + 1, nz, m)``.
    """

    z: Array
    slopes: Array
    inverses: Array


class Anchored(Protocol):
    """The part of `phantom_dyn.loops.chain.Anchor` that is needed here: two frames that stay together."""

    @property
    def kind(self) -> str:
        """``frame`` if the axes of the frames stay together too."""
        ...

    @property
    def frame_a(self) -> int:
        """Index of the first frame."""
        ...

    @property
    def frame_b(self) -> int:
        """Index of the second frame."""
        ...


def anchors_of(model: pin.Model, anchors: Sequence[Anchored], arrays: TreeArrays) -> AnchoredTree:
    """A tree and its anchors, as arrays for the compiled loops."""
    joints, frames = np.zeros((len(anchors), 3), np.int64), np.zeros((len(anchors), 2, 4, 3))
    for k, anchor in enumerate(anchors):
        joints[k, 2] = anchor.kind == "frame"
        for side, index in enumerate((anchor.frame_a, anchor.frame_b)):
            frame = model.frames[index]
            joints[k, side] = frame.parentJoint
            frames[k, side, :3], frames[k, side, 3] = frame.placement.rotation, frame.placement.translation
    return AnchoredTree(arrays.kinematics, joints, frames)


@fused
def close_loops(
    tree: AnchoredTree, S: Array, offset: Array, limits: Limits, q: Array, begin: Array, closed: Closed
) -> int:
    """Write the unknowns of N samples, each found by steps on the straight line from the sample before.

    A step is halved if it is too long, or if Newton's method fails or changes the linear prediction too much. After a
    successful step its length is doubled.

    Args:
        tree: Joints and anchors.
        S: ``S`` of `ClosedChain`, ``(nt, nv + nz)``.
        offset: ``o`` of `ClosedChain`, ``(nt,)``.
        limits: When to stop.
        q: Active positions, ``(N, nv)``.
        begin: Active positions of the known solution from which the first step starts, ``(nv,)``.
        closed: Output: the solutions. Its last row holds the known solution.

    Returns:
        The first sample at which the loops were not closed, N if there is none.
    """
    z, slopes, inverses = closed
    N, nv, nz = len(q), q.shape[1], z.shape[1]
    start, way, target, unknown, trial = begin.copy(), np.empty(nv), np.empty(nv), z[-1].copy(), np.empty(nz)
    slope, inverse = slopes[-1].copy(), inverses[-1].copy()
    next_slope, next_inverse = slope.copy(), inverse.copy()
    for k in range(N):
        # Shares of the way to sample k: the part that is done, and the length of the next step.
        done, part = 0.0, 1.0
        for j in range(nv):
            way[j] = q[k, j] - start[j]
        while done < 1.0:
            part = min(part, 1.0 - done)
            longest = 0.0
            for j in range(nv):
                longest = max(longest, abs(part * way[j]))
                target[j] = q[k, j] if done + part >= 1.0 else start[j] + (done + part) * way[j]
            for i in range(nz):
                trial[i] = unknown[i]
                for j in range(nv):
                    trial[i] += slope[i, j] * (part * way[j])
                longest = max(longest, abs(trial[i] - unknown[i]))
            found = False
            if longest <= limits.reach:
                predicted = trial.copy()
                found = newton(tree, S, offset, target, trial, limits, next_slope, next_inverse)
                for i in range(nz):
                    found = found and abs(trial[i] - predicted[i]) <= limits.correction * longest + limits.last_step
            if found:
                unknown[:], slope[:], inverse[:] = trial, next_slope, next_inverse
                done, part = done + part, 2 * part
                continue
            part /= 2
            # A step that is only too long is halved further. The negated comparison is true for NaN, too.
            if part < limits.shortest and not longest >= limits.reach:
                return k
        start[:] = q[k]
        z[k], slopes[k], inverses[k] = unknown, slope, inverse
    return N


@fused
def drift_loop(tree: AnchoredTree, S: Array, x: Array, v: Array, inverses: Array, out: Array) -> None:
    """Write the accelerations of the tree while no active joint accelerates.

    Args:
        tree: Joints and anchors.
        S: Columns of ``S`` of `ClosedChain` for the unknowns, ``(nt, nz)``.
        x: Positions of the tree, ``(N, nt)``.
        v: Velocities of the tree, ``(N, nt)``.
        inverses: Unknown accelerations per acceleration of the constraint, ``(N, nz, m)``.
        out: Output: the accelerations, ``(N, nt)``.
    """
    m, nz = inverses.shape[2], inverses.shape[1]
    relative, zero = np.empty(m), np.zeros((1, v.shape[1]))
    for k in range(len(x)):
        anchor_acceleration(tree, x[k], v[k : k + 1], zero, relative)
        for i in range(len(S)):
            out[k, i] = 0.0
        for j in range(nz):
            acceleration = 0.0
            for r in range(m):
                acceleration -= inverses[k, j, r] * relative[r]
            for i in range(len(S)):
                out[k, i] += S[i, j] * acceleration


@fused
def newton(
    tree: AnchoredTree, S: Array, offset: Array, q: Array, z: Array, limits: Limits, slope: Array, inverse: Array
) -> bool:
    """Find the unknowns near ``z`` that close the loops at active positions ``q``, by Newton's method.

    Args:
        tree: Joints and anchors.
        S: ``S`` of `ClosedChain`, ``(nt, nv + nz)``.
        offset: ``o`` of `ClosedChain`, ``(nt,)``.
        q: Active positions, ``(nv,)``.
        z: First guess of the unknowns, ``(nz,)``; overwritten by the solution.
        limits: When to stop.
        slope: Output: the derivative of the unknowns by the active positions, ``(nz, nv)``.
        inverse: Output: the inverse of the derivative of the constraints by the unknowns, ``(nz, m)``.

    Returns:
        False if no solution was found, or if the constraints are singular on the way.
    """
    nt, nv, nz, m = len(offset), len(q), len(z), inverse.shape[1]
    x, error, on_tree, both = np.empty(nt), np.empty(m), np.empty((m, nt)), np.empty((m, nv + nz))
    for _ in range(limits.iterations):
        for i in range(nt):
            x[i] = offset[i]
            for j in range(nv):
                x[i] += S[i, j] * q[j]
            for j in range(nz):
                x[i] += S[i, nv + j] * z[j]
        anchor_error(tree, x, error, on_tree)
        for r in range(m):
            for j in range(nv + nz):
                both[r, j] = 0.0
                for i in range(nt):
                    both[r, j] += on_tree[r, i] * S[i, j]
        if not pseudo_inverse(both[:, nv:], limits.singular, inverse):
            return False
        converged, closed = True, True
        for j in range(nz):
            step = 0.0
            for r in range(m):
                step -= inverse[j, r] * error[r]
                closed = closed and abs(error[r]) <= limits.closed
            z[j] += step
            converged = converged and abs(step) <= limits.last_step
        if converged:
            for i in range(nz):
                for j in range(nv):
                    slope[i, j] = 0.0
                    for r in range(m):
                        slope[i, j] -= inverse[i, r] * both[r, j]
            return closed
    return False


@fused
def anchor_error(tree: AnchoredTree, x: Array, error: Array, slope: Array) -> None:
    """Write the distance between the frames of each anchor, in the axes of its first frame, and its derivative.

    Args:
        tree: Joints and anchors.
        x: Positions of the tree, ``(nt,)``.
        error: Output: the distance, ``(m,)``: three components [m] of each anchor, then three components of the
            rotation vector [rad] if the axes stay together.
        slope: Output: the derivative of the distance by ``x``, ``(m, nt)``; exact if the axes are parallel.
    """
    parents, kinds, first_q, first_v, rotations, translations, axes = tree.kinematics
    joints, frames, n, nt = tree.joints, tree.frames, len(parents), len(x)
    R, o, lin, ang = np.zeros((n, 3, 3)), np.zeros((n, 3)), np.empty((nt, 3)), np.empty((nt, 3))
    q, E, p = np.empty((1, first_q[n - 1] + 2)), np.empty((2, 3, 3)), np.empty((2, 3))
    for axis in range(3):
        R[0, axis, axis] = 1.0
    configure(kinds, first_q, first_v, x, q)
    place(parents, kinds, first_q, first_v, rotations, translations, axes, q, 0, R, o, lin, ang)
    slope[:] = 0.0
    r = 0
    for k in range(len(joints)):
        both_frames(joints, frames, k, R, o, E, p)
        error[r], error[r + 1], error[r + 2] = turned_back(
            E, 0, p[1, 0] - p[0, 0], p[1, 1] - p[0, 1], p[1, 2] - p[0, 2]
        )
        if joints[k, 2]:
            error[r + 3], error[r + 4], error[r + 5] = rotation_between(E)
        for side in range(2):
            sign, j = 2.0 * side - 1.0, int(joints[k, side])
            while j > 0:
                d = int(first_v[j])
                ax, ay, az = ang[d, 0], ang[d, 1], ang[d, 2]
                # The second origin is used for both sides, because the axes turn with the first frame.
                lx, ly, lz = cross(ax, ay, az, p[1, 0] - o[j, 0], p[1, 1] - o[j, 1], p[1, 2] - o[j, 2])
                lx, ly, lz = turned_back(E, 0, lx + lin[d, 0], ly + lin[d, 1], lz + lin[d, 2])
                slope[r, d] += sign * lx
                slope[r + 1, d] += sign * ly
                slope[r + 2, d] += sign * lz
                if joints[k, 2]:
                    ax, ay, az = turned_back(E, 0, ax, ay, az)
                    slope[r + 3, d] += sign * ax
                    slope[r + 4, d] += sign * ay
                    slope[r + 5, d] += sign * az
                j = parents[j]
        r += 6 if joints[k, 2] else 3


@fused
def anchor_acceleration(tree: AnchoredTree, x: Array, v: Array, still: Array, out: Array) -> None:
    """Write how the second frame of each anchor accelerates relative to the first, if no joint accelerates.

    Args:
        tree: Joints and anchors; all anchors must be closed at ``x``.
        x: Positions of the tree, ``(nt,)``.
        v: Velocities of the tree, ``(1, nt)``.
        still: Zeros, ``(1, nt)``.
        out: Output: the accelerations in the order of `anchor_error`, ``(m,)``.
    """
    parents, kinds, first_q, first_v, rotations, translations, axes = tree.kinematics
    joints, frames, n, nt = tree.joints, tree.frames, len(parents), len(x)
    R, o, lin, ang = np.zeros((n, 3, 3)), np.zeros((n, 3)), np.empty((nt, 3)), np.empty((nt, 3))
    w, dw, acc, f = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3)), np.empty((2, 3))
    q, E, p = np.empty((1, first_q[n - 1] + 2)), np.empty((2, 3, 3)), np.empty((2, 3))
    for axis in range(3):
        R[0, axis, axis] = 1.0
    configure(kinds, first_q, first_v, x, q)
    place(parents, kinds, first_q, first_v, rotations, translations, axes, q, 0, R, o, lin, ang)
    move(parents, first_v, o, lin, ang, v, still, 0, w, dw, acc)
    r = 0
    for k in range(len(joints)):
        both_frames(joints, frames, k, R, o, E, p)
        for side in range(2):
            j = joints[k, side]
            rx, ry, rz = p[side, 0] - o[j, 0], p[side, 1] - o[j, 1], p[side, 2] - o[j, 2]
            x1, y1, z1 = cross(dw[j, 0], dw[j, 1], dw[j, 2], rx, ry, rz)
            x2, y2, z2 = cross(w[j, 0], w[j, 1], w[j, 2], rx, ry, rz)
            x2, y2, z2 = cross(w[j, 0], w[j, 1], w[j, 2], x2, y2, z2)
            f[side, 0], f[side, 1], f[side, 2] = acc[j, 0] + x1 + x2, acc[j, 1] + y1 + y2, acc[j, 2] + z1 + z2
        out[r], out[r + 1], out[r + 2] = turned_back(E, 0, f[1, 0] - f[0, 0], f[1, 1] - f[0, 1], f[1, 2] - f[0, 2])
        if joints[k, 2]:
            a, b = joints[k, 0], joints[k, 1]
            x1, y1, z1 = dw[b, 0] - dw[a, 0], dw[b, 1] - dw[a, 1], dw[b, 2] - dw[a, 2]
            out[r + 3], out[r + 4], out[r + 5] = turned_back(E, 0, x1, y1, z1)
        r += 6 if joints[k, 2] else 3


@inlined
def configure(kinds: Array, first_q: Array, first_v: Array, x: Array, q: Array) -> None:
    """Write Pinocchio's configuration ``q``, ``(1, nq)``, for the positions ``x`` of the joints."""
    for j in range(1, len(kinds)):
        k, angle = first_q[j], x[first_v[j]]
        if kinds[j] == CONTINUOUS:
            q[0, k], q[0, k + 1] = np.cos(angle), np.sin(angle)
        else:
            q[0, k] = angle


@inlined
def both_frames(joints: Array, frames: Array, k: int, R: Array, o: Array, E: Array, p: Array) -> None:
    """Write rotations ``(2, 3, 3)`` and origins ``(2, 3)`` [m] of the two frames of anchor ``k``."""
    for side in range(2):
        j, f = joints[k, side], frames[k, side]
        for c in range(3):
            E[side, 0, c], E[side, 1, c], E[side, 2, c] = turned(R, j, f[0, c], f[1, c], f[2, c])
        x, y, z = turned(R, j, f[3, 0], f[3, 1], f[3, 2])
        p[side, 0], p[side, 1], p[side, 2] = o[j, 0] + x, o[j, 1] + y, o[j, 2] + z


@inlined
def rotation_between(E: Array) -> tuple[float, float, float]:
    """Rotation vector [rad] of the second frame in the axes of the first."""
    xx, yx, zx = turned_back(E, 0, E[1, 0, 0], E[1, 1, 0], E[1, 2, 0])
    xy, yy, zy = turned_back(E, 0, E[1, 0, 1], E[1, 1, 1], E[1, 2, 1])
    xz, yz, zz = turned_back(E, 0, E[1, 0, 2], E[1, 1, 2], E[1, 2, 2])
    x, y, z = 0.5 * (zy - yz), 0.5 * (xz - zx), 0.5 * (yx - xy)
    sine = np.sqrt(x * x + y * y + z * z)
    angle_per_sine = np.arctan2(sine, 0.5 * (xx + yy + zz - 1)) / sine if sine > _SMALLEST_SINE else 1.0
    return angle_per_sine * x, angle_per_sine * y, angle_per_sine * z
