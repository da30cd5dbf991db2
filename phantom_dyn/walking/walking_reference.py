"""Computes a walk from joystick commands, its stability margin, and a haptic signal of this margin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phantom_dyn.array_types import Array, Float, ReadOnlyArrays
from phantom_dyn.errors import ParameterError
from phantom_dyn.walking.divergent_component import PendulumState
from phantom_dyn.walking.footsteps import Gait, Joystick
from phantom_dyn.walking.pattern import FootMotion, Phase, foot_motion, pendulum_motion, plan_walk
from phantom_dyn.walking.walker import Walker
from phantom_dyn.walking.whole_body import WholeBodyMotion, com_above_slope, whole_body_motion
from phantom_dyn.walking.zmp import SupportPolygon, support_polygon, zmp_from_contact_wrench


@dataclass(frozen=True)
class WalkingReference(ReadOnlyArrays):
    """A walk of ``N`` samples in world axes; the ground is at z = 0.

    Attributes:
        t: Time [s], shape ``(N,)``.
        joystick: Commands of the user over time.
        gait: Lengths, heights and times of the steps.
        phases: The plan.
        pendulum: Planned zero moment point, divergent component and centre of mass.
        left: Motion of the left sole.
        right: Motion of the right sole.
        motion: Motion of the whole robot.
        zmp: Zero moment point of the whole robot with the rotation of all bodies [m], shape ``(N, 2)``.
        polygons: Support polygons, one for each interval with the same feet on the ground.
        margin: Distance of the zero moment point to the edge of its polygon [m], negative outside, shape ``(N,)``.
    """

    t: Float[Array, " N"]
    joystick: Joystick
    gait: Gait
    phases: tuple[Phase, ...]
    pendulum: PendulumState
    left: FootMotion
    right: FootMotion
    motion: WholeBodyMotion
    zmp: Float[Array, "N 2"]
    polygons: tuple[SupportPolygon, ...]
    margin: Float[Array, " N"]

    @property
    def landings(self) -> Float[Array, " L"]:
        """Times at which a foot lands [s], shape ``(L,)``."""
        return np.array([phase.end for phase in self.phases if phase.swing is not None and phase.end <= self.t[-1]])

    def haptic_signal(self, *, silent_above: float) -> Float[Array, " N"]:
        """Amplitude of the joystick's motor between 0 and 1, shape ``(N,)``; see `haptic_signal`."""
        return haptic_signal(self.margin, silent_above=silent_above)


def haptic_signal(margin: Float[Array, " N"], *, silent_above: float) -> Float[Array, " N"]:
    """Amplitude of the joystick's motor: 0 for a large margin, and linear up to 1 where the robot starts to tip.

    In the incomplete source a motor signals to the user how stable the walk is, but there is no equation for the
    signal; this equation is a choice of this project.

    Args:
        margin: Distance of the zero moment point to the edge of its polygon [m], shape ``(N,)``.
        silent_above: Margin from which the signal is zero [m].

    Raises:
        ParameterError: If ``silent_above`` is not positive.
    """
    if not silent_above > 0:
        raise ParameterError(
            f"The haptic signal is to be silent above a margin of {silent_above:g} m: give more than 0."
        )
    return np.clip(1.0 - margin / silent_above, 0.0, 1.0)


def walk(
    walker: Walker, joystick: Joystick, *, duration: float, gait: Gait | None = None, rate: float = 100.0
) -> WalkingReference:
    """Walk from standing at the origin under the commands of a joystick.

    The joystick is read at each landing, so a stop takes two steps at most: the current step, and a step that puts the
    feet side by side. The centre of mass is a linear inverted pendulum whose divergent component is planned in closed
    form. Inverse kinematics gives the joints. The zero moment point is that of the whole robot. The walk is a reference
    without a controller: where its margin is negative, the robot would tip.

    Args:
        walker: The biped.
        joystick: Commands over time; at each time the walk depends on past commands only.
        duration: Duration of the walk [s].
        gait: Lengths and times of the steps; by default the standard gait with the walker's distance of the feet.
        rate: Sample rate [Hz].

    Raises:
        ParameterError: If the joystick commands more than the gait allows, or a leg cannot follow.
    """
    if not (duration > 0 and rate > 0 and duration * rate >= 1):
        raise ParameterError(f"A walk of {duration:g} s at {rate:g} Hz has no sample: give a longer one.")
    gait = gait or Gait(foot_distance=walker.foot_distance)
    g = -float(walker.model.gravity.linear[2])
    omega = float(np.sqrt(g / walker.com_height))
    phases = plan_walk(joystick, gait, duration, omega)
    t = np.arange(round(duration * rate)) / rate
    pendulum = pendulum_motion(phases, t, omega)
    left, right = (foot_motion(phases, t, side, gait.step_height) for side in ("left", "right"))
    motion = whole_body_motion(walker, com_above_slope(pendulum, walker.com_height, 0.0), left, right)
    zmp = zmp_from_contact_wrench(walker.model, motion.q, motion.v, motion.a)
    polygons, index = _polygons(walker, left, right)
    margin = np.empty(len(t))
    for k, polygon in enumerate(polygons):
        margin[index == k] = polygon.margin(zmp[index == k])
    return WalkingReference(t, joystick, gait, phases, pendulum, left, right, motion, zmp, polygons, margin)


def _polygons(walker: Walker, left: FootMotion, right: FootMotion) -> tuple[tuple[SupportPolygon, ...], Array]:
    """Support polygons, and the index of the polygon at each sample, shape ``(N,)``."""
    on_ground = np.stack([left.contact, right.contact], axis=1)
    placed = np.hstack([left.position * on_ground[:, :1], right.position * on_ground[:, 1:]])
    state = np.hstack([on_ground, placed])
    changed = np.concatenate([[True], (state[1:] != state[:-1]).any(axis=1)])
    polygons = []
    for k in np.flatnonzero(changed):
        feet = [foot.position[k] for foot in (left, right) if foot.contact[k]]
        polygons.append(support_polygon(np.vstack([walker.corners_at(foot)[:, :2] for foot in feet])))
    return tuple(polygons), np.cumsum(changed) - 1
