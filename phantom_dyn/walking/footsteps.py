"""Joystick commands over time, and the footsteps that follow from them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from phantom_dyn.array_types import Array, Bool, Float, ReadOnlyArrays
from phantom_dyn.errors import ParameterError
from phantom_dyn.number_checks import require_positive

Side = Literal["left", "right"]


@dataclass(frozen=True)
class Command:
    """Setting of the joystick at one time: ``speed`` [m/s], ``turn`` [rad/s, positive to the left], ``walking``."""

    speed: float
    turn: float
    walking: bool


@dataclass(frozen=True)
class Joystick(ReadOnlyArrays):
    """Settings of a joystick over time. Each applies until the next one; before the first one the robot stands still.

    Attributes:
        t: Times of changes [s], increasing, shape ``(K,)``.
        speed: Commanded forward speed [m/s], negative backwards, shape ``(K,)``.
        turn: Commanded turning rate [rad/s], positive to the left, shape ``(K,)``.
        walking: True after the start button, False after the stop button, shape ``(K,)``.
    """

    t: Float[Array, " K"]
    speed: Float[Array, " K"]
    turn: Float[Array, " K"]
    walking: Bool[Array, " K"]

    def __post_init__(self):
        super().__post_init__()
        for name in ("t", "speed", "turn"):
            if not np.isfinite(getattr(self, name)).all():
                raise ParameterError(f"The joystick's {name} has a value that is not finite: give numbers.")
        if not len(self.t) or (np.diff(self.t) <= 0).any():
            raise ParameterError("The joystick's times must increase, and there must be one: sort them.")

    def at(self, time: float) -> Command:
        """Setting of the joystick at ``time`` [s]."""
        k = int(np.searchsorted(self.t, time, side="right")) - 1
        if k < 0:
            return Command(0.0, 0.0, False)
        return Command(float(self.speed[k]), float(self.turn[k]), bool(self.walking[k]))

    def next_start(self, time: float) -> float | None:
        """First time [s] at or after ``time`` at which walking is set, or None."""
        if self.at(time).walking:
            return time
        later = self.t[(self.t > time) & self.walking]
        return float(later[0]) if later.size else None


@dataclass(frozen=True)
class Gait:
    """Lengths and times of the steps; times in s, lengths in m, angles in rad.

    Attributes:
        foot_distance: Lateral distance between the middles of the soles, as in `Walker.foot_distance`.
        single_support: Time on one foot in each step.
        double_support: Time on both feet in each step, before the time on one foot.
        settle: Time in which the weight moves to the middle between the feet after the last step.
        step_height: Greatest height of the swinging sole.
        longest_step: Longest advance of the body in one step.
        largest_turn: Largest turn of the body in one step.
    """

    foot_distance: float
    single_support: float = 0.6
    double_support: float = 0.2
    settle: float = 0.6
    step_height: float = 0.04
    longest_step: float = 0.15
    largest_turn: float = 0.2

    def __post_init__(self):
        require_positive("the gait", **vars(self))

    @property
    def step_time(self) -> float:
        """Time of one step [s]."""
        return self.double_support + self.single_support


@dataclass(frozen=True)
class Footstep:
    """A sole on the ground: its middle [m] and its heading [rad, about z, not wrapped]."""

    x: float
    y: float
    heading: float

    @property
    def point(self) -> Float[Array, " 2"]:
        """Middle of the sole [m], shape ``(2,)``."""
        return np.array([self.x, self.y])


@dataclass(frozen=True)
class Stance:
    """Positions of both soles and of the body between them, from which the next step starts."""

    left: Footstep
    right: Footstep
    body: Footstep

    def foot(self, side: Side) -> Footstep:
        """Sole of a side."""
        return self.left if side == "left" else self.right

    @property
    def middle(self) -> Float[Array, " 2"]:
        """Point between the soles [m], shape ``(2,)``."""
        return (self.left.point + self.right.point) / 2


def standing(gait: Gait) -> Stance:
    """Stance with one foot on each side of the origin, heading along x."""
    body = Footstep(0.0, 0.0, 0.0)
    return Stance(_beside(body, "left", gait), _beside(body, "right", gait), body)


def other(side: Side) -> Side:
    """The other side."""
    return "right" if side == "left" else "left"


def stepped(stance: Stance, swing: Side, command: Command, gait: Gait) -> Stance:
    """Stance after a step with the foot ``swing`` under a command.

    Raises:
        ParameterError: If the command requires a longer step or a larger turn than the gait allows.
    """
    advance, turn = command.speed * gait.step_time, command.turn * gait.step_time
    for change, value, limit, unit in (
        ("an advance", advance, gait.longest_step, "m"),
        ("a turn", turn, gait.largest_turn, "rad"),
    ):
        if abs(value) > limit:
            raise ParameterError(
                f"The joystick asks for {change} of {value:g} {unit} in a step, more than the gait's {limit:g} {unit}: "
                "move the stick less or take another gait."
            )
    # The body advances in the mean of its headings before and after the step.
    mean_heading = stance.body.heading + turn / 2
    body = Footstep(
        stance.body.x + advance * np.cos(mean_heading),
        stance.body.y + advance * np.sin(mean_heading),
        stance.body.heading + turn,
    )
    return _with_foot(stance, swing, _beside(body, swing, gait), body)


def closed(stance: Stance, swing: Side, gait: Gait) -> Stance:
    """Stance after the foot ``swing`` was put next to the other foot."""
    fixed = stance.foot(other(swing))
    body = _beside(fixed, swing, gait)
    return _with_foot(stance, swing, _beside(body, swing, gait), body)


def _with_foot(stance: Stance, side: Side, foot: Footstep, body: Footstep) -> Stance:
    """The stance with new positions of one foot and of the body."""
    return replace(stance, left=foot, body=body) if side == "left" else replace(stance, right=foot, body=body)


def _beside(body: Footstep, side: Side, gait: Gait) -> Footstep:
    """Place at half the foot distance to one side of ``body``; for the place of the body, ``body`` may be a foot."""
    aside = gait.foot_distance / 2 * (1 if side == "left" else -1)
    return Footstep(
        float(body.x - aside * np.sin(body.heading)), float(body.y + aside * np.cos(body.heading)), body.heading
    )
