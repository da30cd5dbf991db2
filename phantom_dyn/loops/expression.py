"""Expressions such as ``pi/2 - j5``: sums of numbers and multiples of joints, read without running them."""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field


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


def linear_expression(text: str, joints: Sequence[str]) -> LinearExpression:
    """What an expression says.

    Args:
        text: Sums and differences of numbers, ``pi``, and joints, with numbers as factors.
        joints: Names that may be used; ``pi`` is the number unless a joint is called so.

    Raises:
        ValueError: If it is anything else; the text says which part, as the end of a sentence.
    """
    coded, names = _coded(text, joints)
    try:
        tree = ast.parse(coded.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError):
        raise ValueError("it cannot be read") from None
    return _read(tree, names)


def _coded(text: str, joints: Sequence[str]) -> tuple[str, dict[str, str]]:
    """The text with every joint as an identifier, and the joint of each: names may hold dots, dashes or slashes."""
    codes = {joint: f"_joint_{index}_" for index, joint in enumerate(joints)}
    if not codes:
        return text, {}
    longest_first = sorted(codes, key=len, reverse=True)
    pattern = "|".join(rf"(?<![\w.]){re.escape(joint)}(?!\w)" for joint in longest_first)
    return re.sub(pattern, lambda found: codes[found.group()], text), {code: joint for joint, code in codes.items()}


def _read(node: ast.expr, names: dict[str, str]) -> LinearExpression:
    match node:
        case ast.Constant(value=int() | float() as value) if not isinstance(value, bool) and math.isfinite(value):
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
            raise ValueError(f"{name!r} in it is none of {', '.join(names.values()) or 'the active joints'}, nor pi")
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
