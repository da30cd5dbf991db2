"""Linear loops of robot.yaml: each passive joint as numbers times joints that are not."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from phantom_dyn.errors import RobotError
from phantom_dyn.loops.expression import LinearExpression, linear_expression
from phantom_dyn.robot_config import LinearLoop


def followed_joints(loops: Iterable[tuple[int, LinearLoop]], config: Path) -> dict[str, LinearExpression]:
    """Expression of each joint that follows others, in joints that follow none.

    Args:
        loops: Linear loops with their places in the list ``loops``.
        config: The file, for messages.

    Raises:
        RobotError: If an expression is not linear, or a joint follows twice or itself.
    """
    stated: dict[str, LinearExpression] = {}
    for index, loop in loops:
        if not loop.passive:
            raise RobotError(f"{config}: loops[{index}].passive is empty: give each passive joint its expression.")
        for name, text in loop.passive.items():
            place = f"{config}: loops[{index}].passive.{name}"
            if name in stated or name in loop.active:
                other = "in another loop already" if name in stated else "active in the same loop"
                raise RobotError(f"{place} is {other}: a passive joint stands in one loop, and only as passive.")
            stated[name] = _read(text, loop.active, place)
    return {name: _resolved(name, stated, (), config) for name in stated}


def _read(text: str, active: list[str], place: str) -> LinearExpression:
    try:
        return linear_expression(text, active)
    except ValueError as problem:
        raise RobotError(
            f"{place} is {text!r}, and {problem}: wanted a sum of numbers, pi and multiples of the loop's active "
            "joints, such as 'pi/2 - 2*j5'."
        ) from None


def _resolved(name: str, stated: dict[str, LinearExpression], asked: tuple[str, ...], config: Path) -> LinearExpression:
    """Expression of a joint with every follower in it replaced by what that one follows."""
    if name in asked:
        circle = " follows ".join([*asked[asked.index(name) :], name])
        raise RobotError(f"{config}: the loops lead in a circle ({circle}): give one of these joints as active.")
    out = LinearExpression(stated[name].constant)
    for joint, factor in stated[name].factors.items():
        one = LinearExpression(0.0, {joint: 1.0})
        out = out.plus((_resolved(joint, stated, (*asked, name), config) if joint in stated else one).scaled(factor))
    return out
