"""From phases to samples: the pendulum and both feet, with velocities and accelerations."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Bool, Float

from phantom_dyn.motion import read_only
from phantom_dyn.walking.divergent_component import PendulumState, pendulum
from phantom_dyn.walking.footsteps import Footstep, Side
from phantom_dyn.walking.pattern import Phase

Array = np.ndarray


@dataclass(frozen=True)
class FootMotion:
    """A sole over time: x, y, z of its middle [m] and heading [rad]; shapes ``(N, 4)``, contact ``(N,)``."""

    position: Float[Array, "N 4"]
    velocity: Float[Array, "N 4"]
    acceleration: Float[Array, "N 4"]
    contact: Bool[Array, " N"]

    def __post_init__(self):
        for name in ("position", "velocity", "acceleration"):
            object.__setattr__(self, name, read_only(getattr(self, name)))


def pendulum_motion(phases: tuple[Phase, ...], t: Float[Array, " N"], omega: float) -> PendulumState:
    """Samples of the pendulum at times ``t`` [s] that the phases cover."""
    parts = []
    for phase, own in _by_phase(phases, t):
        parts.append(pendulum(own, phase.profile, phase.points, phase.dcm, phase.com, omega))
    return PendulumState(*(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(PendulumState)))


def foot_motion(phases: tuple[Phase, ...], t: Float[Array, " N"], side: Side, step_height: float) -> FootMotion:
    """Samples of one sole at times ``t`` [s] that the phases cover.

    It swings by a polynomial of fifth order along the ground and one of sixth order in height, so that velocity and
    acceleration are zero at lift-off and landing.
    """
    parts = []
    for phase, own in _by_phase(phases, t):
        before, after = _pose(phase.stance.foot(side)), _pose(phase.landing.foot(side))
        air = phase.profile.duration - phase.profile.ramp
        moving = phase.swing == side
        s = np.clip((own - phase.profile.ramp) / air, 0.0, 1.0)[:, None] if moving else np.zeros((len(own), 1))
        air = air if moving else 1.0
        lift = np.array([0.0, 0.0, step_height, 0.0])
        along, up = _minimum_jerk(s), _bump(s)
        order = [(after - before) * along[k] / air**k + lift * up[k] / air**k for k in range(3)]
        parts.append((before + order[0], order[1], order[2], (s[:, 0] == 0.0) | (s[:, 0] == 1.0)))
    return FootMotion(*(np.concatenate([part[k] for part in parts]) for k in range(4)))


def _by_phase(phases: tuple[Phase, ...], t: Array) -> list[tuple[Phase, Array]]:
    """Each phase that holds samples, with their times since its start."""
    index = np.clip(np.searchsorted([phase.start for phase in phases], t, side="right") - 1, 0, None)
    return [(phases[k], t[index == k] - phases[k].start) for k in np.unique(index)]


def _pose(foot: Footstep) -> Array:
    return np.array([foot.x, foot.y, 0.0, foot.heading])


def _minimum_jerk(s: Array) -> tuple[Array, Array, Array]:
    """10 s^3 - 15 s^4 + 6 s^5 and its derivatives."""
    return (
        s**3 * (10 - 15 * s + 6 * s**2),
        30 * s**2 * (1 - s) ** 2,
        60 * s * (1 - s) * (1 - 2 * s),
    )


def _bump(s: Array) -> tuple[Array, Array, Array]:
    """64 s^3 (1 - s)^3 and its derivatives: one at the middle, zero with two derivatives at both ends."""
    c = s * (1 - s)
    return 64 * c**3, 192 * c**2 * (1 - 2 * s), 384 * c * ((1 - 2 * s) ** 2 - c)
