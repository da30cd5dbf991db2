"""Reads linear loops of robot.yaml, in which each passive joint is an expression of active joints: ``pi/2 - j5``.

Expressions are sums of numbers and multiples of joints. They are parsed to Python's syntax tree, and never evaluated
as Python code.
"""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from phantom_dyn.errors import RobotError, shortened
from phantom_dyn.model.robot_config import LinearLoop

# Largest number of letters of an expression, which limits the depth of recursion.
_LONGEST = 400
# Largest constant [rad or m] and largest factor.
_LARGEST = 1e6


@dataclass(frozen=True)
class LinearExpression:
    """``constant`` [rad or m] plus a factor times the position of each joint in ``factors``."""

    constant: float = 0.0
    factors: dict[str, float] = field(default_factory=dict)

    def scaled(self, by: float) -> LinearExpression:
        """The expression times a number."""
        return LinearExpression(by * self.constant, {joint: by * factor for joint, factor in self.factors.items()})

    def plus(self, other: LinearExpression) -> LinearExpression:
        """The sum of two expressions."""
        joints = dict.fromkeys([*self.factors, *other.factors])
        factors = {joint: self.factors.get(joint, 0.0) + other.factors.get(joint, 0.0) for joint in joints}
        return LinearExpression(self.constant + other.constant, factors)


def following_joints(loops: Iterable[tuple[int, LinearLoop]], config: Path) -> dict[str, LinearExpression]:
    """Passive joints, each with its expression in joints that are not passive.

    Args:
        loops: Linear loops with their indices in the list ``loops``.
        config: Path of the configuration for messages.

    Raises:
        RobotError: If an expression is not linear, a joint has two expressions, or expressions lead in a circle.
    """
    stated: dict[str, LinearExpression] = {}
    for index, loop in loops:
        if not loop.passive:
            raise RobotError(f"{config}: loops[{index}].passive is empty: give each passive joint its expression.")
        for name, text in loop.passive.items():
            place = f"{config}: loops[{index}].passive.{name}"
            if name in stated or name in loop.active:
                other = "in another loop already" if name in stated else "active in the same loop"
                raise RobotError(f"{place} is {other}: name it once, in one loop, and only as passive.")
            stated[name] = _stated_expression(text, loop.active, place)
    return {name: _resolved(name, stated, (), config) for name in stated}


def linear_expression(text: str, joints: Sequence[str]) -> LinearExpression:
    """Expression from its text.

    Args:
        text: Sums and differences of numbers, ``pi`` and joints, with numbers as factors.
        joints: Names of joints that may be used; ``pi`` is the number unless a joint has this name.

    Raises:
        ValueError: If the text is anything else; the message continues a sentence about the text.
    """
    if len(text) > _LONGEST:
        raise ValueError(f"it has more than {_LONGEST} letters")
    coded, names = _coded(text, joints)
    try:
        tree = ast.parse(coded.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):  # deeply nested brackets raise the last one
        raise ValueError("it cannot be read") from None
    found = _read(tree, names)
    if not all(abs(value) <= _LARGEST for value in (found.constant, *found.factors.values())):
        raise ValueError(f"its numbers are beyond {_LARGEST:g}")
    return found


def _stated_expression(text: str, active: list[str], place: str) -> LinearExpression:
    try:
        return linear_expression(text, active)
    except ValueError as problem:
        raise RobotError(
            f"{place} is {shortened(text)!r}, and {problem}: wanted a sum of numbers, pi and multiples of the loop's "
            "active joints, such as 'pi/2 - 2*j5'."
        ) from None


def _resolved(name: str, stated: dict[str, LinearExpression], asked: tuple[str, ...], config: Path) -> LinearExpression:
    """Expression of a joint in which all passive joints are replaced by their expressions."""
    if name in asked:
        circle = " follows ".join([*asked[asked.index(name) :], name])
        raise RobotError(f"{config}: the loops lead in a circle ({circle}): give one of these joints as active.")
    out = LinearExpression(stated[name].constant)
    for joint, factor in stated[name].factors.items():
        one = LinearExpression(0.0, {joint: 1.0})
        out = out.plus((_resolved(joint, stated, (*asked, name), config) if joint in stated else one).scaled(factor))
    return out


def _coded(text: str, joints: Sequence[str]) -> tuple[str, dict[str, str]]:
    """The text with an identifier in place of each joint name, and the joint name of each identifier.

    Names of joints may contain dots, dashes or slashes, which would be read as operators.
    """
    codes = {joint: f"_joint_{index}_" for index, joint in enumerate(joints)}
    if not codes:
        return text, {}
    longest_first = sorted(codes, key=len, reverse=True)
    pattern = "|".join(rf"(?<![\w.]){re.escape(joint)}(?!\w)" for joint in longest_first)
    return re.sub(pattern, lambda found: codes[found.group()], text), {code: joint for joint, code in codes.items()}


def _read(node: ast.expr, names: dict[str, str]) -> LinearExpression:
    """Expression of a node of the syntax tree; ``names`` are the joints by their identifiers."""
    match node:
        case ast.Constant(value=int() | float() as value) if not isinstance(value, bool) and abs(value) <= _LARGEST:
            return LinearExpression(float(value))
        case ast.Name(id=name) if name in names:
            return LinearExpression(0.0, {names[name]: 1.0})
        case ast.Name(id="pi"):
            return LinearExpression(math.pi)
        case ast.UnaryOp(op=ast.UAdd() | ast.USub() as sign, operand=operand):
            return _read(operand, names).scaled(-1.0 if isinstance(sign, ast.USub) else 1.0)
        case ast.BinOp(left=left, op=ast.Add() | ast.Sub() as sign, right=right):
            return _read(left, names).plus(_read(right, names).scaled(-1.0 if isinstance(sign, ast.Sub) else 1.0))
        case ast.BinOp(left=left, op=ast.Mult(), right=right):
            return _product(_read(left, names), _read(right, names))
        case ast.BinOp(left=left, op=ast.Div(), right=right):
            return _quotient(_read(left, names), _read(right, names))
        case ast.Name(id=name):
            raise ValueError(
                f"{shortened(name)!r} in it is none of {', '.join(names.values()) or 'the active joints'}, nor pi"
            )
    raise ValueError("it is more than a sum of numbers and multiples of joints")


def _product(left: LinearExpression, right: LinearExpression) -> LinearExpression:
    if left.factors and right.factors:
        raise ValueError("it multiplies two joints")
    return right.scaled(left.constant) if right.factors else left.scaled(right.constant)


def _quotient(left: LinearExpression, right: LinearExpression) -> LinearExpression:
    if right.factors:
        raise ValueError("it divides by a joint")
    if right.constant == 0:
        raise ValueError("it divides by zero")
    return left.scaled(1 / right.constant)
