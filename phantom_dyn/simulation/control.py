"""Controllers of simulated drives, which interpolate tables of references, gains and torques over time.

`Tracking` is the only controller that compiled simulations evaluate without Python.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from phantom_dyn.array_types import Array, Float, ReadOnlyArrays
from phantom_dyn.errors import ParameterError


@dataclass(frozen=True)
class Tracking(ReadOnlyArrays):
    r"""Drive torque :math:`\mathrm{clip}(f + k_p (q_r - q) + k_d (v_r - v)) + e` from tables over time.

    The tables are interpolated linearly, and are constant before the first and after the last time.

    Attributes:
        t: Times [s], increasing, at least two, shape ``(N,)``.
        feedforward: Torque f [N m or N], shape ``(N, nv)``.
        q_ref: Reference positions [rad or m], shape ``(N, nv)``.
        v_ref: Reference velocities, shape ``(N, nv)``.
        kp: Gains [N m/rad or N/m], shape ``(N, nv)``.
        kd: Gains [N m s/rad or N s/m], shape ``(N, nv)``.
        extra: Torque e, which is added after the limit, shape ``(N, nv)``.
        limits: Torque limits of the part in brackets, shape ``(nv,)``; infinite without a limit.
    """

    t: Float[Array, " N"]
    feedforward: Float[Array, "N nv"]
    q_ref: Float[Array, "N nv"]
    v_ref: Float[Array, "N nv"]
    kp: Float[Array, "N nv"]
    kd: Float[Array, "N nv"]
    extra: Float[Array, "N nv"]
    limits: Float[Array, " nv"]

    def __post_init__(self):
        super().__post_init__()
        if self.t.ndim != 1 or len(self.t) < 2 or not (np.diff(self.t) > 0).all():
            raise ParameterError("The times of a tracking law do not increase: give at least two.")
        wanted = (len(self.t), len(np.atleast_1d(self.limits)))
        for name in ("feedforward", "q_ref", "v_ref", "kp", "kd", "extra"):
            table = getattr(self, name)
            if table.shape != wanted:
                raise ParameterError(
                    f"{name} of a tracking law has shape {table.shape}, wanted {wanted}: times by joints."
                )
            if not np.isfinite(table).all():
                raise ParameterError(f"{name} of a tracking law is not finite everywhere: give finite numbers.")
        if not (self.limits >= 0).all():
            raise ParameterError("A limit of a tracking law is negative or not a number: give zero or more.")

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        """Torque [N m or N] at time ``t`` from position readings and velocities, shape ``(nv,)``."""
        k = int(np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self.t) - 2))
        share = min(max((t - self.t[k]) / (self.t[k + 1] - self.t[k]), 0.0), 1.0)
        f, q_ref, v_ref, kp, kd, extra = (
            (1.0 - share) * table[k] + share * table[k + 1]
            for table in (self.feedforward, self.q_ref, self.v_ref, self.kp, self.kd, self.extra)
        )
        return np.clip(f + kp * (q_ref - q) + kd * (v_ref - v), -self.limits, self.limits) + extra


def with_late_references(law: Tracking, delays: Float[Array, " nv"]) -> Tracking:
    """The law with delayed references; before the first reference arrives, the value of the first reference applies.

    Args:
        law: Law with the references at the times at which they are sent.
        delays: Delay of each joint [s], shape ``(nv,)``.
    """

    def late(table: Array) -> Array:
        columns = zip(table.T, delays, strict=True)
        return np.column_stack([np.interp(law.t - delay, law.t, column) for column, delay in columns])

    return replace(law, q_ref=late(law.q_ref), v_ref=late(law.v_ref))


def torque_over_time(t: Float[Array, " N"], torque: Float[Array, "N nv"]) -> Tracking:
    """A controller that commands given torques [N m or N] for any motion."""
    torque = np.asarray(torque, dtype=float)
    if torque.ndim != 2:
        raise ParameterError(f"The torque has shape {torque.shape}, wanted a row a time and a column a joint.")
    none = np.zeros_like(torque)
    return Tracking(t, torque, none, none, none, none, none, np.full(torque.shape[1], np.inf))


def position_control(
    t: Float[Array, " N"],
    q_ref: Float[Array, "N nv"],
    v_ref: Float[Array, "N nv"],
    *,
    kp: Float[Array, " nv"],
    kd: Float[Array, " nv"],
) -> Tracking:
    """A position controller with constant gains and without a limit; arguments as in `Tracking`."""
    q_ref = np.asarray(q_ref, dtype=float)
    none = np.zeros_like(q_ref)
    gains = np.broadcast_to(kp, q_ref.shape), np.broadcast_to(kd, q_ref.shape)
    return Tracking(t, none, q_ref, v_ref, *gains, none, np.full(q_ref.shape[-1], np.inf))
