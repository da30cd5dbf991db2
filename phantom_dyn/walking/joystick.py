"""What the user does with the controller: speed, direction, start and stop over time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from phantom_dyn.errors import ParameterError
from phantom_dyn.motion import read_only

Array = np.ndarray


@dataclass(frozen=True)
class Command:
    """The controller at one time: ``speed`` [m/s], ``turn`` [rad/s, positive to the left], ``walking`` or not."""

    speed: float
    turn: float
    walking: bool


@dataclass(frozen=True)
class Joystick:
    """A controller over time; what was set holds until the next sample, and before the first one the robot stands.

    Attributes:
        t: Times of changes [s], increasing, shape ``(K,)``.
        speed: Forward speed from the stick [m/s], negative backwards, shape ``(K,)``.
        turn: Turning rate from the stick [rad/s], positive to the left, shape ``(K,)``.
        walking: True from the start button to the stop button, shape ``(K,)``.
    """

    t: Float[Array, " K"]
    speed: Float[Array, " K"]
    turn: Float[Array, " K"]
    walking: Bool[Array, " K"]

    def __post_init__(self):
        for name in ("t", "speed", "turn"):
            values = read_only(getattr(self, name))
            if not np.isfinite(values).all():
                raise ParameterError(f"The joystick's {name} has a value that is not finite: give numbers.")
            object.__setattr__(self, name, values)
        object.__setattr__(self, "walking", read_only(self.walking, bool))
        if not len(self.t) or (np.diff(self.t) <= 0).any():
            raise ParameterError("The joystick's times must increase, and there must be one: sort them.")

    def at(self, time: float) -> Command:
        """What is set at ``time`` [s]."""
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
