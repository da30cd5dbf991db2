"""Plans a walk in phases, and computes the motion of the pendulum and of both feet.

The plan is causal: each step follows from the joystick's setting at the previous landing, and the plan assumes that the
setting does not change later. If it changes, the zero moment point is off the middle of the sole for one step, by up to
two centimetres (for a change from full forward to full backward).
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from phantom_dyn.array_types import Array, Bool, Float, ReadOnlyArrays
from phantom_dyn.motion import minimum_jerk
from phantom_dyn.walking.divergent_component import PendulumState, Profile, entry, holding_point, pendulum
from phantom_dyn.walking.footsteps import (
    Command,
    Footstep,
    Gait,
    Joystick,
    Side,
    Stance,
    closed,
    other,
    standing,
    stepped,
)

PREVIEW = 6
"""Number of steps planned ahead. Later steps have the weight exp(-omega T PREVIEW), below 1e-5 for usual gaits."""


@dataclass(frozen=True)
class Phase:
    """One phase of the walk, between two landings.

    Attributes:
        start: Start of the phase [s].
        profile: Timing of the zero moment point.
        points: Zero moment point at the start and after the ramp [m].
        dcm: Divergent component at the start [m].
        com: Centre of mass at the start [m].
        stance: Feet at the start.
        landing: Feet at the end; the same as at the start if no foot swings.
        swing: Foot that is in the air after the ramp, or None.
    """

    start: float
    profile: Profile
    points: tuple[Float[Array, " 2"], Float[Array, " 2"]]
    dcm: Float[Array, " 2"]
    com: Float[Array, " 2"]
    stance: Stance
    landing: Stance
    swing: Side | None

    @property
    def end(self) -> float:
        """End of the phase [s]."""
        return self.start + self.profile.duration


@dataclass(frozen=True)
class FootMotion(ReadOnlyArrays):
    """Motion of a sole: x, y, z of its middle [m] and its heading [rad]; ``contact`` is True on the ground."""

    position: Float[Array, "N 4"]
    velocity: Float[Array, "N 4"]
    acceleration: Float[Array, "N 4"]
    contact: Bool[Array, " N"]


def plan_walk(joystick: Joystick, gait: Gait, duration: float, omega: float) -> tuple[Phase, ...]:
    """Phases of a walk of ``duration`` [s] that starts with both feet at the origin.

    Args:
        joystick: Commands of the user over time.
        gait: Lengths, heights and times of the steps.
        duration: Time to plan for [s].
        omega: Square root of gravity over the height of the centre of mass [1/s].

    Raises:
        ParameterError: If the joystick commands more than the gait allows.
    """
    stance = standing(gait)
    phases: list[Phase] = []
    time, com = 0.0, stance.middle
    while time < duration:
        start = joystick.next_start(time)
        until = duration if start is None else min(start, duration)
        if until > time:
            phases.append(_rest(time, until - time, stance, com))
            time, com = until, _end(phases[-1], omega)[1]
            continue
        phases += _walk_until_stop(joystick, gait, time, duration, stance, com, omega)
        time, stance, com = phases[-1].end, phases[-1].landing, _end(phases[-1], omega)[1]
    return tuple(phases)


def pendulum_motion(phases: tuple[Phase, ...], t: Float[Array, " N"], omega: float) -> PendulumState:
    """Motion of the pendulum at times ``t`` [s] within the phases."""
    parts = [
        pendulum(own, phase.profile, phase.points, phase.dcm, phase.com, omega) for phase, own in _by_phase(phases, t)
    ]
    return PendulumState(*(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(PendulumState)))


def foot_motion(phases: tuple[Phase, ...], t: Float[Array, " N"], side: Side, step_height: float) -> FootMotion:
    """Motion of one sole at times ``t`` [s] within the phases.

    The sole follows a polynomial of fifth order along the ground and of sixth order in height, so velocity and
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
        along, up = minimum_jerk(s), _bump(s)
        order = [(after - before) * along[k] / air**k + lift * up[k] / air**k for k in range(3)]
        parts.append((before + order[0], order[1], order[2], (s[:, 0] == 0.0) | (s[:, 0] == 1.0)))
    return FootMotion(*(np.concatenate([part[k] for part in parts]) for k in range(4)))


def _walk_until_stop(
    joystick: Joystick, gait: Gait, time: float, duration: float, stance: Stance, com: Array, omega: float
) -> list[Phase]:
    """Phases from a first step with the right foot until the feet stand next to each other, or until ``duration``."""
    swing: Side = "right"
    step = Profile(gait.double_support, gait.step_time)
    settle = Profile(gait.settle, gait.settle)
    point, dcm, phases = stance.middle, stance.middle, []

    def add(profile: Profile, landing: Stance, moving: Side | None, onward: tuple[float, Array]) -> None:
        nonlocal time, point, dcm, com, stance
        hold = holding_point(dcm, point, profile, onward, omega)
        phases.append(Phase(time, profile, (point, hold), dcm, com, stance, landing, moving))
        dcm, com = _end(phases[-1], omega)
        time, point, stance = phases[-1].end, hold, landing

    # At rest, the zero moment point first moves to the foot that lifts next, which accelerates the body to the other
    # foot.
    add(step, stance, None, _onward(stance, swing, joystick.at(time), gait, omega))
    while True:
        command = joystick.at(time)
        if not command.walking:
            landing = closed(stance, swing, gait)
            add(step, landing, swing, entry(landing.middle[None], (settle,), omega))
            # The previous phase was planned so that this phase ends at rest over the middle of the feet. The middle is
            # used instead of the computed point, because rounding errors would grow.
            phases.append(Phase(time, settle, (point, landing.middle), dcm, com, landing, landing, None))
            return phases
        landing = stepped(stance, swing, command, gait)
        add(step, landing, swing, _onward(landing, other(swing), command, gait, omega))
        swing = other(swing)
        if time >= duration:
            return phases


def _onward(stance: Stance, swing: Side, command: Command, gait: Gait, omega: float) -> tuple[float, Array]:
    """Required divergent component at the start of the step with ``swing``, as ``alpha`` and ``beta`` of `entry`.

    The command is assumed not to change.
    """
    points = []
    for _ in range(PREVIEW):
        points.append(stance.foot(other(swing)).point)
        stance, swing = stepped(stance, swing, command, gait), other(swing)
    profile = Profile(gait.double_support, gait.step_time)
    return entry(np.array(points), (profile,) * len(points), omega)


def _rest(time: float, duration: float, stance: Stance, com: Array) -> Phase:
    """A phase at rest, with the zero moment point between the feet."""
    middle = stance.middle
    return Phase(time, Profile(duration, duration), (middle, middle), middle, com, stance, stance, None)


def _end(phase: Phase, omega: float) -> tuple[Array, Array]:
    """Divergent component and centre of mass at the end of a phase."""
    last = pendulum(np.array([phase.profile.duration]), phase.profile, phase.points, phase.dcm, phase.com, omega)
    return last.dcm[0], last.com[0]


def _by_phase(phases: tuple[Phase, ...], t: Array) -> list[tuple[Phase, Array]]:
    """Each phase with samples, and the times of its samples since its start."""
    index = np.clip(np.searchsorted([phase.start for phase in phases], t, side="right") - 1, 0, None)
    return [(phases[k], t[index == k] - phases[k].start) for k in np.unique(index)]


def _pose(foot: Footstep) -> Array:
    return np.array([foot.x, foot.y, 0.0, foot.heading])


def _bump(s: Array) -> tuple[Array, Array, Array]:
    """64 s^3 (1 - s)^3 and its first two derivatives: 1 in the middle; all three are zero at both ends."""
    c = s * (1 - s)
    return 64 * c**3, 192 * c**2 * (1 - 2 * s), 384 * c * ((1 - 2 * s) ** 2 - c)
