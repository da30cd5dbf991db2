r"""Plans a walk up or down stairs with the plan for level ground, and its stability margin for soles at two heights.

The centre of mass moves in a plane :math:`z = k x + h`, and the zero moment point p in the plane :math:`z = k x` of the
footholds, where k is the rise divided by the tread. The moment balance of a point mass is

.. math:: (x - p)(\ddot z + g) = \ddot x\,(z - z_p), \qquad \ddot z = k \ddot x, \quad z - z_p = k (x - p) + h.

The products cancel, and :math:`\ddot x = \frac{g}{h} (x - p)` remains, as on level ground with the same :math:`\omega`.
So the plan of `phantom_dyn.walking.pattern` applies unchanged, from both feet on one tread to both feet on another. It
applies only to a walk straight ahead, because after a turn the footholds are not in the plane of the slope.

In double support the soles are at two heights. Their contact points are then projected along the contact force, see
`phantom_dyn.walking.zmp.support_polygon_along`.

References:
    S. Kajita et al., The 3D linear inverted pendulum mode, IROS 2001 (cited from memory): the pendulum is linear on any
    constraint plane. The incomplete source of this package names walking upstairs (Kim and Kim, 2009) without an
    equation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from phantom_dyn.array_types import Array, Float, ReadOnlyArrays
from phantom_dyn.errors import ParameterError
from phantom_dyn.motion import minimum_jerk
from phantom_dyn.walking.divergent_component import PendulumState
from phantom_dyn.walking.footsteps import Gait, Joystick, Side
from phantom_dyn.walking.pattern import FootMotion, Phase, foot_motion, pendulum_motion, plan_walk
from phantom_dyn.walking.walker import Walker
from phantom_dyn.walking.whole_body import ComMotion, WholeBodyMotion, com_above_slope, whole_body_motion
from phantom_dyn.walking.zmp import contact_wrench, support_polygon_along, zmp_of_wrench

_SIDES: tuple[Side, Side] = ("left", "right")
# Time on both feet before the first step [s].
_START = 0.2
# Shares of a swing upstairs in which a sole rises, and in which it moves forward: it rises first, to clear the edge.
_UP, _FORWARD = (0.0, 0.6), (0.25, 1.0)


@dataclass(frozen=True)
class Stairs:
    """A straight flight of stairs. Tread n has its middle at x = n times the tread, at the height n times the rise.

    Attributes:
        tread: Length of a tread [m].
        rise: Height of a step [m], negative downstairs.

    Raises:
        ParameterError: If the tread is not above 0, or the rise not finite.
    """

    tread: float
    rise: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.tread) and self.tread > 0 and math.isfinite(self.rise)):
            raise ParameterError(
                f"Stairs with a tread of {self.tread} m and a rise of {self.rise} m were given: give a length above 0 "
                "and a height."
            )

    @property
    def slope(self) -> float:
        """Rise divided by tread."""
        return self.rise / self.tread

    def height(self, x: Float[Array, " n"]) -> Float[Array, " n"]:
        """Height of the stairs [m] at x [m], shape ``(n,)``."""
        return self.rise * np.round(x / self.tread)


@dataclass(frozen=True)
class StairReference(ReadOnlyArrays):
    """A walk of ``N`` samples over stairs along x.

    Attributes:
        t: Time [s], shape ``(N,)``.
        stairs: The stairs.
        phases: The horizontal plan.
        pendulum: Planned zero moment point, divergent component and centre of mass, horizontal.
        com: Motion of the centre of mass, in its plane above the slope.
        left: Motion of the left sole.
        right: Motion of the right sole.
        motion: Motion of the whole robot.
        zmp: Zero moment point of the whole robot in the plane of the footholds [m], shape ``(N, 3)``.
        margin: Distance of the zero moment point to the edge of the support polygon [m], shape ``(N,)``.
        clearance: Smallest height of the soles above the stairs [m], shape ``(N,)``.
    """

    t: Float[Array, " N"]
    stairs: Stairs
    phases: tuple[Phase, ...]
    pendulum: PendulumState
    com: ComMotion
    left: FootMotion
    right: FootMotion
    motion: WholeBodyMotion
    zmp: Float[Array, "N 3"]
    margin: Float[Array, " N"]
    clearance: Float[Array, " N"]


def stair_gait(walker: Walker, stairs: Stairs) -> Gait:
    """A slow gait with one tread per step that lifts the sole by 6 cm plus half the rise."""
    return Gait(
        foot_distance=walker.foot_distance,
        single_support=1.0,
        double_support=0.3,
        settle=1.0,
        step_height=0.06 + 0.5 * abs(stairs.rise),
        longest_step=stairs.tread,
    )


def zmp_on_slope(force: Float[Array, "N 3"], moment: Float[Array, "N 3"], slope: float) -> Float[Array, "N 3"]:
    """Point [m] in the plane z = slope x about which a wrench has no horizontal moment, shape ``(N, 3)``.

    Args:
        force: Contact force [N], upwards in every sample, shape ``(N, 3)``.
        moment: Contact moment about the world's origin [N m], shape ``(N, 3)``.
        slope: Slope of the plane along x.
    """
    level = zmp_of_wrench(force, moment)
    along = force[:, :2] / force[:, 2:]
    # Along the force from z = 0 to the plane: x = x0 + z fx/fz with z = slope x.
    x = level[:, 0] / (1.0 - slope * along[:, 0])
    z = slope * x
    return np.column_stack([x, level[:, 1] + z * along[:, 1], z])


def climb(
    walker: Walker, stairs: Stairs, steps: int, *, gait: Gait | None = None, rate: float = 100.0
) -> StairReference:
    """Walk over stairs, one tread per step, from both feet on the tread at the origin to both feet on the last tread.

    Args:
        walker: The biped.
        stairs: The stairs.
        steps: Number of treads, two or more.
        gait: Lengths and times of the steps; by default `stair_gait`, because a foot passes two treads in a step.
        rate: Sample rate [Hz].

    Raises:
        ParameterError: If there are fewer than two steps, the soles are longer than a tread, or a leg cannot follow.
    """
    sole = float(np.ptp(walker.corners[:, 0]))
    if steps != int(steps) or steps < 2 or not rate > 0:
        raise ParameterError(f"{steps} steps at {rate:g} Hz were asked for: give a whole number of 2 or more.")
    if sole > stairs.tread:
        raise ParameterError(
            f"The soles are {sole:g} m long and the treads {stairs.tread:g} m: give treads that are longer."
        )
    gait = gait or stair_gait(walker, stairs)
    speed = stairs.tread / gait.step_time
    # The first step of a walk only shifts the weight; the last step puts both feet on the same tread.
    stop = _START + (steps + 0.5) * gait.step_time
    joystick = Joystick(
        t=np.array([_START, stop]), speed=np.array([speed, 0.0]), turn=np.zeros(2), walking=np.array([True, False])
    )
    omega = math.sqrt(-float(walker.model.gravity.linear[2]) / walker.com_height)
    phases = plan_walk(joystick, gait, stop + 2 * gait.step_time + gait.settle, omega)
    t = np.arange(round(phases[-1].end * rate)) / rate
    pendulum = pendulum_motion(phases, t, omega)
    left, right = (_raised(foot_motion(phases, t, side, gait.step_height), side, phases, stairs, t) for side in _SIDES)
    com = com_above_slope(pendulum, walker.com_height, stairs.slope)
    motion = whole_body_motion(walker, com, left, right)
    force, moment = contact_wrench(walker.model, motion.q, motion.v, motion.a)
    point = zmp_of_wrench(force, moment)
    margin = np.empty(len(t))
    for k in range(len(t)):
        corners = np.vstack([walker.corners_at(foot.position[k]) for foot in (left, right) if foot.contact[k]])
        margin[k] = support_polygon_along(corners, force[k]).margin(point[k : k + 1])[0]
    return StairReference(
        t=t,
        stairs=stairs,
        phases=phases,
        pendulum=pendulum,
        com=com,
        left=left,
        right=right,
        motion=motion,
        zmp=zmp_on_slope(force, moment, stairs.slope),
        margin=margin,
        clearance=_clearance(stairs, (left, right), sole),
    )


def _raised(foot: FootMotion, side: Side, phases: tuple[Phase, ...], stairs: Stairs, t: Array) -> FootMotion:
    """Motion of a sole on stairs from its motion on level ground: upstairs first up, downstairs first forward."""
    position, velocity, acceleration = foot.position.copy(), foot.velocity.copy(), foot.acceleration.copy()
    for phase in phases:
        within = (t >= phase.start) & (t < phase.end)
        before, after = phase.stance.foot(side), phase.landing.foot(side)
        low, high = stairs.height(np.array([before.x, after.x]))
        if phase.swing != side:
            position[within, 2] += low
            continue
        air = phase.profile.duration - phase.profile.ramp
        own = (t[within] - phase.start - phase.profile.ramp) / air
        up, forward = (_UP, _FORWARD) if stairs.rise >= 0 else (_mirrored(_UP), _mirrored(_FORWARD))
        rise, along = (_eased(own, *span) for span in (up, forward))
        for k, part in enumerate((position, velocity, acceleration)):
            part[within, 2] += (high - low) * rise[k] / air**k + (low if k == 0 else 0.0)
            part[within, 0] = (after.x - before.x) * along[k] / air**k + (before.x if k == 0 else 0.0)
    return replace(foot, position=position, velocity=velocity, acceleration=acceleration)


def _mirrored(span: tuple[float, float]) -> tuple[float, float]:
    return 1.0 - span[1], 1.0 - span[0]


def _eased(s: Array, begin: float, end: float) -> tuple[Array, Array, Array]:
    """Minimum-jerk transition from 0 at ``begin`` to 1 at ``end``, and its first two derivatives."""
    width = end - begin
    x, v, a = minimum_jerk(np.clip((s - begin) / width, 0.0, 1.0))
    return x, v / width, a / width**2


def _clearance(stairs: Stairs, feet: tuple[FootMotion, FootMotion], sole: float) -> Float[Array, " N"]:
    """Smallest height of the soles above the stairs, at points that are a twentieth of a sole apart."""
    along = sole * np.linspace(-0.5, 0.5, 21)
    heights = []
    for foot in feet:
        under = stairs.height((foot.position[:, :1] + along).ravel()).reshape(-1, len(along))
        heights.append((foot.position[:, 2:3] - under).min(axis=1))
    return np.minimum(*heights)
