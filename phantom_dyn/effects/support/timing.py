"""Base class of effects that make the torque of a drive later: a delay or a lag, of one drive or of all."""

from __future__ import annotations

from phantom_dyn.array_types import Array
from phantom_dyn.effects.effect import Effect
from phantom_dyn.effects.rival import Shape, SpecialCase
from phantom_dyn.model.robot import Robot

LONGEST = 1.0
"""Longest time that is fitted [s]: with a longer one the recorded torque would not be related to the motion."""


class Timing(Effect):
    """An effect with one number, the time by which one drive, or all drives together, are late."""

    scope = "either"
    acts_as = "drive"
    changes_with = "controller"

    def places(self, robot: Robot) -> tuple[str | None, ...]:
        """Places to search: all joints together (None), and each joint alone; a single joint has one place."""
        return (None, *robot.joint_names) if robot.nv > 1 else robot.joint_names

    def coefficient_bounds(self, robot: Robot, joint: str | None, shape: Shape) -> tuple[tuple[float, float], ...]:
        """Bounds of the time [s]: zero and `LONGEST`."""
        return ((0.0, LONGEST),)

    def special_cases(
        self, robot: Robot, joint: str | None, coefficients: Array, shape: Shape
    ) -> tuple[SpecialCase, ...]:
        """No effect: a time of zero, or one at its upper bound, where the fit does not determine it."""
        return SpecialCase((), coefficients), SpecialCase((), coefficients - LONGEST)
