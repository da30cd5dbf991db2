"""What effects have in common that make the torque of a drive later: a delay or a lag of one drive, or of all."""

from __future__ import annotations

from phantom_dyn.array_types import Array
from phantom_dyn.effects.effect import Effect
from phantom_dyn.effects.rival import Shape, SpecialCase
from phantom_dyn.model.robot import Robot

LONGEST = 1.0
"""Longest time that is fitted [s]: with a longer one the recorded torque would not be related to the motion."""


class Timing(Effect):
    """One time, from zero to the longest, of all drives together or of one."""

    scope = "either"
    changes_with = "controller"

    def places(self, robot: Robot) -> tuple[str | None, ...]:
        """All joints together (None) and each joint; on a robot with one joint only this joint."""
        return (None, *robot.joint_names) if robot.nv > 1 else robot.joint_names

    def coefficient_bounds(self, robot: Robot, joint: str | None, shape: Shape) -> tuple[tuple[float, float], ...]:
        """From zero to the longest time."""
        return ((0.0, LONGEST),)

    def special_cases(
        self, robot: Robot, joint: str | None, coefficients: Array, shape: Shape
    ) -> tuple[SpecialCase, ...]:
        """No delay, and the longest one."""
        return SpecialCase((), coefficients), SpecialCase((), coefficients - LONGEST)
