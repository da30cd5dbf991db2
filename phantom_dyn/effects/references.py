"""Drive torques that position controllers compute from references, so that a late reference can be put into them.

Only the reference arrives late: the feedback is that of the drive itself. Where the torque that a controller asks for
is known for the reference as it was sent, the torque for a later one differs by the gain times the change of the
reference, within the limits of the drive.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phantom_dyn.array_types import Array, Float
from phantom_dyn.motion import read_only


@dataclass(frozen=True)
class References:
    """References of position controllers and the torques that these ask for; joints without a gain have no loop.

    Attributes:
        t: Times [s], increasing, shape ``(N,)``.
        q_ref: References as they were sent [rad or m], shape ``(N, nv)``.
        asked: Torque that each controller asks for with these, before any limit [N m or N], shape ``(N, nv)``.
        gain: Torque per unit of the reference [N m/rad or N/m], zero where nothing follows one, shape ``(nv,)``.
        limits: What the drives clip the asked torque at, infinite where they do not, shape ``(nv,)``.
        least: Least delay of each reference [s] that a reading of the drives' output allows, shape ``(nv,)``.
        most: Largest one, infinite where no output was read.
    """

    t: Float[Array, " N"]
    q_ref: Float[Array, "N nv"]
    asked: Float[Array, "N nv"]
    gain: Float[Array, " nv"]
    limits: Float[Array, " nv"]
    least: Float[Array, " nv"]
    most: Float[Array, " nv"]

    def __post_init__(self):
        for name in ("t", "q_ref", "asked", "gain", "limits", "least", "most"):
            object.__setattr__(self, name, read_only(getattr(self, name)))

    def later(self, delay: float, rows: tuple[int, ...]) -> Float[Array, "N m"]:
        """Torque of the drives more when their references arrive ``delay`` seconds later; before the first, it holds.

        Args:
            delay: [s].
            rows: Joints.
        """
        late = self.q_ref.copy()
        for row in rows:
            late[:, row] = np.interp(self.t - delay, self.t, self.q_ref[:, row])
        return self.with_references(late)[:, list(rows)]

    def with_references(self, q_ref: Float[Array, "N nv"]) -> Float[Array, "N nv"]:
        """Torque of the drives more with other references [rad or m]."""
        then = self.asked + self.gain * (q_ref - self.q_ref)
        return np.clip(then, -self.limits, self.limits) - np.clip(self.asked, -self.limits, self.limits)
