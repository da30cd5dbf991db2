# pyright: reportAttributeAccessIssue=false
"""Motion of a robot's joints and of its base, and Pinocchio's configurations for it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from phantom_dyn.array_types import Array, Float, ReadOnlyArrays

Rows = slice | np.ndarray

# Samples that `side_by_side` copies at a time.
_BLOCK = 4096


@dataclass(frozen=True)
class BaseMotion(ReadOnlyArrays):
    """Motion of the root of a robot that is not bolted down, in the root's own axes.

    The pose of the root is not needed, because torques depend only on the attributes below.

    Attributes:
        w: Angular velocity [rad/s], shape ``(N, 3)``.
        dw: Angular acceleration [rad/s^2], shape ``(N, 3)``.
        f: Specific force at the origin of the root [m/s^2], shape ``(N, 3)``: the acceleration minus gravity, which an
            accelerometer measures.
    """

    w: Float[Array, "N 3"]
    dw: Float[Array, "N 3"]
    f: Float[Array, "N 3"]

    @property
    def columns(self) -> Float[Array, "N 9"]:
        """Angular velocity, angular acceleration and specific force side by side."""
        return np.hstack([self.w, self.dw, self.f])

    def at(self, rows: Rows) -> BaseMotion:
        """The motion at some of the samples."""
        return BaseMotion(self.w[rows], self.dw[rows], self.f[rows])


@dataclass(frozen=True)
class Motion(ReadOnlyArrays):
    """``N`` samples of a robot's joint motion.

    Attributes:
        t: Time [s], shape ``(N,)``, increasing.
        q: Joint positions [rad or m], shape ``(N, nv)``: one scalar per joint, also for continuous joints.
        v: Velocities [rad/s or m/s], shape ``(N, nv)``.
        a: Accelerations [rad/s^2 or m/s^2], shape ``(N, nv)``.
        base: Motion of the root; None if the robot is bolted down.
    """

    t: Float[Array, " N"]
    q: Float[Array, "N nv"]
    v: Float[Array, "N nv"]
    a: Float[Array, "N nv"]
    base: BaseMotion | None = field(default=None, kw_only=True)

    def at(self, rows: Rows) -> Motion:
        """The motion at some of the samples."""
        base = None if self.base is None else self.base.at(rows)
        return Motion(self.t[rows], self.q[rows], self.v[rows], self.a[rows], base=base)

    def with_joints(self, q: Float[Array, "N nv"], v: Float[Array, "N nv"], a: Float[Array, "N nv"]) -> Motion:
        """Another motion of the joints, with the same times and the same motion of the root."""
        return Motion(self.t, q, v, a, base=self.base)


def joined_bases(bases: Sequence[BaseMotion | None]) -> BaseMotion | None:
    """Concatenate motions of the base; None if the robot is bolted down."""
    known = [base for base in bases if base is not None]
    if len(known) < len(bases):
        return None
    return BaseMotion(*(np.concatenate([getattr(base, name) for base in known]) for name in ("w", "dw", "f")))


def configurations(model: pin.Model, positions: Float[Array, "N nt"]) -> Float[Array, "N nq"]:
    """Configurations of a model at the positions of its joints [rad or m]; a continuous joint gives cos and sin."""
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


def linear_joints(model: pin.Model) -> np.ndarray:
    """True where a joint slides, False where it turns, shape ``(nt,)``; each joint has one velocity."""
    return np.array([joint.shortname().startswith("JointModelP") for joint in list(model.joints)[1:]], dtype=bool)


def side_by_side(columns: Sequence[Float[Array, " N"]]) -> Float[Array, "N k"]:
    """Join columns to one read-only array."""
    out = np.empty((len(columns[0]), len(columns)))
    # Copying in blocks is faster: the block of ``out`` stays in the processor's cache.
    for start in range(0, len(out), _BLOCK):
        rows = slice(start, start + _BLOCK)
        for k, column in enumerate(columns):
            out[rows, k] = column[rows]
    out.flags.writeable = False
    return out


def minimum_jerk(s: Float[Array, "*n"]) -> tuple[Float[Array, "*n"], Float[Array, "*n"], Float[Array, "*n"]]:
    """Minimum-jerk transition 10 s^3 - 15 s^4 + 6 s^5 from 0 to 1, and its first two derivatives."""
    return s**3 * (10 - 15 * s + 6 * s**2), 30 * s**2 * (1 - s) ** 2, 60 * s * (1 - s) * (1 - 2 * s)
