"""Friction that is elastic as a whole: no part of the modelled Coulomb torque is a step. Oracle: what was put in."""

import pytest

from identification.diagnosis.result import Diagnosis

NAME = "presliding_friction"
# The model's Coulomb torque of the elbow is 0.2 N m. The robot's friction has that size, and all of it builds up.
THETA = (0.2, 0.005, -0.2)


@pytest.fixture(scope="module")
def found(diagnosed) -> Diagnosis:
    return diagnosed((NAME, "elbow", THETA))


def test_it_is_named_and_nothing_else_is(found):
    assert found.verdict == "explained"
    assert [(finding.effect, finding.joint) for finding in found.findings] == [(NAME, "elbow")]


@pytest.mark.parametrize(("name", "truth"), list(zip(("torque", "displacement", "coulomb_torque"), THETA, strict=True)))
def test_its_numbers_are_within_their_intervals(found, name, truth):
    stated = found.findings[0].parameters[name]
    assert abs(stated.value - truth) < 1.96 * stated.std
