"""Backlash: a play of full width ``gap`` between motor and link.

When the transmitted torque ``tl`` changes its sign, the link becomes loose and crosses the gap in a free flight. During
the flight the drive torque lacks ``tl``; at its end an impact restores the velocity that the link had lost relative to
the motor. Flight and impact cancel on average, so that only frequencies above one over the time of flight show the
effect. Friction changes its sign with the velocity, and backlash with the transmitted torque: gravity separates the
two. Compliance shows a resonance whose frequency does not depend on the amplitude. Friction and rotor are assumed to be
on the motor's side, and impacts to be plastic.
MJCF: a second joint on the same axis with the gap as its ``range``, the rotor as the first one's ``armature``; URDF has
no place for it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phantom_dyn._kernels.jit import inlined_jit, jit
from phantom_dyn.effects.author import (
    Array,
    Effect,
    EffectWords,
    Float,
    ModelNumbers,
    Operation,
    Parameter,
    Robot,
    Shape,
    Signature,
    Simulated,
    Transmission,
    row_of,
)
from phantom_dyn.effects.support.displaced import behind_encoder, change_by_link, load_and_inertia
from phantom_dyn.effects.support.rows import branch_rows
from phantom_dyn.effects.transmission.transmission_compliance import followed_load, moving_mass

# Shortest time of flight whose gap is tried [s].
_FLIGHT = 0.008
# Ratio of one tried gap to the one before.
_GAP_RATIO = 1.7
# Smallest tried gap, as a share of the widest: two seconds of arc, half a micrometre.
_FINEST = 1e-4
# Lowest, usual and highest cutoff [Hz] of the low pass that removes encoder noise from the load. The low pass must keep
# the changes of sign of the load, at which the link becomes loose.
_EDGES = (15.0, 60.0, 60.0)
# Frequency [Hz] and damping ratio of rotor and link in contact in a simulation: stiff and nearly without bouncing.
_CONTACT, _CONTACT_DAMPING = 120.0, 0.7
# Play that a user would notice by hand [rad, m].
_WIDEST, _WIDEST_LINEAR = 0.1, 0.005


def with_unfiltered_load(operation: Operation, joint: str | None, own: Array, shape: Array) -> Float[Array, "N nv"]:
    """Torque of backlash, computed from the load without a low pass, so that encoder noise acts on it unfiltered."""
    row = row_of(operation.robot, joint)
    return own[0] * _change_under(operation, row, float(shape[0]), *load_and_inertia(operation, row))


class Backlash(Effect):
    """Backlash of one joint. The shape is the gap, and the coefficient should be one."""

    name = "backlash"
    regime = "velocity_reversal"
    made_of = ("model",)
    acts_as = "drive"
    shows_with = "slow motion"
    fitted = "size in shape"
    other_laws = (with_unfiltered_load,)
    words = EffectWords(
        name="backlash",
        meaning="play in the transmission: the link is loose over a small angle",
        next_step="Check the play by hand with the motor held, tighten or preload the transmission, or model the play.",
        size="of {gap}",
        parameters={"gap": "full width of the play, on the joint side"},
        shown_over=("transmitted",),
        separated_by="link encoder",
    )

    def parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """One parameter: ``gap``, the full width of the play."""
        row = row_of(robot, joint)
        return (
            Parameter(
                "gap",
                robot.position_units[row],
                0.0,
                plausible=(0.0, _WIDEST_LINEAR if robot.prismatic[row] else _WIDEST),
                plausible_because="a play of more than six degrees or five millimetres is felt by hand",
            ),
        )

    def shapes(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[Shape, ...]:
        """Gaps to try: from that which the link crosses in `_FLIGHT`, at its typical torque rate, to the widest."""
        row = row_of(robot, joint)
        load, inertia = followed_load(operation, row, _EDGES)
        crossings = np.flatnonzero(load[1:] * load[:-1] < 0)
        if len(crossings) == 0:
            return ()
        steps = operation.t[crossings + 1] - operation.t[crossings]
        slopes = np.abs(load[crossings + 1] - load[crossings]) / steps / inertia[crossings]
        widest = _WIDEST_LINEAR if robot.prismatic[row] else _WIDEST
        least = min(max(float(np.median(slopes)) * _FLIGHT**3 / 6.0, _FINEST * widest), widest)
        return tuple((least * _GAP_RATIO**k,) for k in range(int(np.log(widest / least) / np.log(_GAP_RATIO)) + 1))

    def refined(self, coefficients: Array, shape: Shape) -> tuple[Shape, ...]:
        """The same gap, and some up to a fifth smaller and a quarter larger."""
        return tuple((factor * shape[0],) for factor in (0.8, 0.93, 1.0, 1.07, 1.25))

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """One column: additional drive torque with the gap ``shape``, from missing load in flight and from impacts."""
        row = row_of(robot, joint)
        values = _change(operation, row, shape[0])
        rows = branch_rows(robot, joint)
        return Signature(rows, values[:, list(rows), None], ("share",), ("1",))

    def coefficient_bounds(self, robot: Robot, joint: str | None, shape: Shape) -> tuple[tuple[float, float], ...]:
        """Near one: the load is known, so that only errors of computed flights and impacts change the coefficient."""
        return ((0.5, 1.5),)

    def from_coefficients(self, robot: Robot, joint: str | None, coefficients: Array, shape: Shape) -> Array:
        """The gap, which is the shape."""
        return np.array([shape[0]])

    def untestable(self, robot: Robot, operation: Operation, joint: str | None) -> str | None:
        """Reason if the link never becomes loose, or the encoder is on the link's side and does not show the gap."""
        row = row_of(robot, joint)
        hidden = behind_encoder(robot, row)
        if hidden is None and not _changes_sign(operation.transmitted[:, row]):
            return "the transmitted torque never changes sign"
        return hidden

    def looks_like(self, robot: Robot, operation: Operation, joint: str | None, other: str, theta: Array) -> bool:
        """True for an encoder offset of half a gap if the load keeps its sign: the motor is ahead of the link by it.

        A gap may be twice as wide as the widest that is plausible.
        """
        row = row_of(robot, joint)
        load, widest = operation.transmitted[:, row], _WIDEST_LINEAR if robot.prismatic[row] else _WIDEST
        if other != "encoder_offset" or behind_encoder(robot, row) is not None or _changes_sign(load):
            return False
        return bool(0.0 < np.sign(load.mean()) * theta.item() <= widest)

    def torque(self, robot: Robot, operation: Operation, joint: str | None, theta: Array) -> Array:
        """Minus the additional drive torque with this gap."""
        return -_change(operation, row_of(robot, joint), theta.item())

    def link_ahead(self, operation: Operation, joint: str | None, theta: Array) -> Array:
        """How far the link is ahead of its motor within the play [rad or m], shape ``(N, nv)``."""
        out = np.zeros_like(operation.q)
        row = row_of(operation.robot, joint)
        load, inertia = load_and_inertia(operation, row)
        out[:, row] = -play(operation.t, load / inertia, theta.item()).lead
        return out

    def simulated(self, robot: Robot, joint: str | None, theta: Array) -> Simulated:
        """A transmission with play and stiff contacts."""
        row = row_of(robot, joint)
        mass, omega = moving_mass(robot, row), 2.0 * np.pi * _CONTACT
        damping = 2.0 * _CONTACT_DAMPING * mass * omega
        return Simulated(transmission=Transmission(robot.joint_names[row], mass * omega**2, damping, theta.item()))

    def model_numbers(self, robot: Robot, joint: str | None, theta: Array) -> ModelNumbers:
        """The gap, which describes the effect completely."""
        return ModelNumbers(whole=True, gap=theta.item())


@dataclass(frozen=True)
class Play:
    """Motion of a link in its play, arrays of shape ``(N,)``.

    Attributes:
        lead: How far the motor is ahead of the link [rad or m], from minus half the gap to plus half the gap.
        rate: Time derivative of ``lead``.
        loose: One where the link is free, otherwise zero.
        impact: Acceleration of the link relative to the motor by impacts; each impact is distributed over two samples.
    """

    lead: Float[Array, " N"]
    rate: Float[Array, " N"]
    loose: Float[Array, " N"]
    impact: Float[Array, " N"]


def play(t: Float[Array, " N"], pull: Float[Array, " N"], gap: float) -> Play:
    """Motion of a link in its play while its motor moves as recorded.

    Args:
        t: Time [s].
        pull: Acceleration of the motor relative to a free link: transmitted torque over link inertia.
        gap: Full width of the play [rad or m].
    """
    lead, rate, loose, impact = np.zeros((4, len(t)))
    _cross(t, pull, np.gradient(t), 0.5 * gap, lead, rate, loose, impact)
    return Play(lead, rate, loose, impact)


@jit
def _cross(
    t: Array, pull: Array, width: Array, half: float, lead: Array, rate: Array, loose: Array, impact: Array
) -> None:
    """Write the motion of the link in its play into arrays of zeros, flight after flight.

    Args:
        t: Time [s].
        pull: Acceleration of the motor relative to a free link.
        width: Duration of each sample [s].
        half: Half the gap.
        lead: Output: how far the motor is ahead of the link.
        rate: Output: time derivative of ``lead``.
        loose: Output: one where the link is free.
        impact: Output: acceleration by impacts.
    """
    side, k = (1.0 if pull[0] >= 0 else -1.0), 0
    while True:
        start = k
        while start < len(t) and not side * pull[start] < 0:
            lead[start] = side * half
            start += 1
        if start >= len(t) - 1:
            lead[start:] = side * half
            return
        k, side = _fly(t, pull, half, start, side, lead, rate, loose)
        # The impact gives the link back the velocity that it lost relative to its motor in flight.
        lost_velocity = 0.0
        for i in range(start, k):
            lost_velocity += loose[i] * pull[i] * width[i]
        # The later the gap is crossed between samples k - 1 and k, the more of the impact belongs to sample k.
        share_of_last = min(max((half - abs(lead[k - 1])) / max(abs(lead[k] - lead[k - 1]), 1e-300), 0.0), 1.0)
        impact[k - 1] += (1.0 - share_of_last) * lost_velocity / width[k - 1]
        impact[k] += share_of_last * lost_velocity / width[k]
        lead[k] = side * half


@inlined_jit
def _fly(
    t: Array, pull: Array, half: float, start: int, side: float, lead: Array, rate: Array, loose: Array
) -> tuple[int, float]:
    """Write the flight that begins on ``side`` just before sample ``start``; returns its last sample and side."""
    place, speed, k = side * half, 0.0, start
    if start > 0 and side * pull[start - 1] >= 0:
        since = (t[start] - t[start - 1]) * pull[start] / (pull[start] - pull[start - 1])
        speed, place = 0.5 * since * pull[start], place + since**2 * pull[start] / 6.0
    for k in range(start, len(t) - 1):
        lead[k], rate[k], loose[k] = place, speed, 1.0
        h = t[k + 1] - t[k]
        place += h * (speed + h * (2.0 * pull[k] + pull[k + 1]) / 6.0)
        speed += 0.5 * h * (pull[k] + pull[k + 1])
        if abs(place) >= half:
            break
    lead[k + 1] = place
    return k + 1, (1.0 if place > 0 else -1.0)


def _changes_sign(load: Float[Array, " N"]) -> bool:
    """True if a load [N m or N] has both signs."""
    return bool(load.min() < 0 < load.max())


def _change(operation: Operation, row: int, gap: float) -> Float[Array, "N nv"]:
    """Additional torque of the links, compared with links without play."""
    return _change_under(operation, row, gap, *followed_load(operation, row, _EDGES))


def _change_under(operation: Operation, row: int, gap: float, load: Array, inertia: Array) -> Float[Array, "N nv"]:
    """Additional torque of the links with a given load and inertia of the link, compared with links without play."""
    moved = play(operation.t, load / inertia, gap)
    link_acceleration = moved.impact - load / inertia * moved.loose
    change = change_by_link(operation, row, -moved.lead, -moved.rate, link_acceleration)
    free = moved.loose > 0
    # No torque is transmitted to a free link, whatever its position and speed.
    change[free, row] = (inertia * link_acceleration)[free]
    return change
