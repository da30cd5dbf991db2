from __future__ import annotations

import math

import pytest

from phantom_dyn.model.linear_loops import LinearExpression, linear_expression

JOINTS = ("q2", "q5", "arm-1", "arm")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("q5 - q2", LinearExpression(0.0, {"q5": 1.0, "q2": -1.0})),
        ("pi/2 - q5", LinearExpression(math.pi / 2, {"q5": -1.0})),
        ("-(2*q2 + 3)/4", LinearExpression(-0.75, {"q2": -0.5})),
        ("+q2*1e-3", LinearExpression(0.0, {"q2": 1e-3})),
        ("q2 + q2", LinearExpression(0.0, {"q2": 2.0})),
        ("2*arm-1 - arm", LinearExpression(0.0, {"arm-1": 2.0, "arm": -1.0})),
        ("0.3", LinearExpression(0.3)),
    ],
)
def test_sums_of_numbers_and_multiples_of_joints_are_read(text, expected):
    assert linear_expression(text, JOINTS) == expected


def test_a_joint_called_pi_is_a_joint():
    assert linear_expression("2*pi", ("pi",)) == LinearExpression(0.0, {"pi": 2.0})


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("q2*q5", "it multiplies two joints"),
        ("1/q2", "it divides by a joint"),
        ("q2/(1 - 1)", "it divides by zero"),
        ("sin(q2)", "it is more than a sum"),
        ("q2**1", "it is more than a sum"),
        ("True*q2", "it is more than a sum"),
        ("__import__('os')", "it is more than a sum"),
        ("q7 - q2", "'q7' in it is none of q2, q5, arm-1, arm, nor pi"),
        ("q2 -", "it cannot be read"),
        ("", "it cannot be read"),
    ],
)
def test_anything_else_is_refused_with_its_reason(text, reason):
    with pytest.raises(ValueError, match=reason):
        linear_expression(text, JOINTS)
