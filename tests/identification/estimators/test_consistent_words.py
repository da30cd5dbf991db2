from __future__ import annotations

import numpy as np
import pytest

from identification.estimators.consistent_regions import region_of_points
from identification.estimators.consistent_words import body_inconsistencies, inconsistencies
from phantom_dyn.dynamics import standard_parameters
from phantom_dyn.errors import ParameterError
from phantom_dyn.inertia import body_parameters

BALL = body_parameters(2.0, np.array([0.1, 0.2, 0.3]), 0.01 * np.eye(3))


@pytest.mark.parametrize(
    "possible",
    [
        BALL,
        body_parameters(2.0, np.array([0.1, 0.2, 0.3]), np.diag([0.1, 0.1, 0.2])),  # a plate
        body_parameters(2.0, np.array([0.1, 0.2, 0.3]), np.zeros((3, 3))),  # a point
        np.zeros(10),
    ],
)
def test_a_ball_a_plate_a_point_and_nothing_are_possible(possible):
    assert body_inconsistencies(possible) == ()


@pytest.mark.parametrize(
    ("broken", "message"),
    [
        (-BALL, "its mass (m) is -2 kg, below zero."),
        (np.r_[0.0, BALL[1:]], "it has no mass (m), but first moments or inertia (mx to Izz)."),
        (body_parameters(1.0, np.ones(3), np.diag([-0.5, 1, 1])), "principal inertia about the centre of mass (Ixx to "
         "Izz, with m, mx, my, mz) is -0.5 kg m^2, below zero."),
        (body_parameters(1.0, np.ones(3), np.diag([1.0, 1, 3])), "is 3 kg m^2, more than the two others together, 2"),
    ],
)  # fmt: skip
def test_each_broken_law_is_a_sentence(broken, message):
    (sentence,) = body_inconsistencies(broken)
    assert message in sentence


def test_a_centre_outside_its_shape_is_told_with_its_distance():
    cube = region_of_points(np.array([[i, j, k] for i in (-0.1, 0.1) for j in (-0.1, 0.1) for k in (-0.1, 0.1)]))
    light = body_parameters(1.0, np.array([0.15, 0, 0]), 1e-6 * np.eye(3))
    (sentence,) = body_inconsistencies(light, cube)
    assert sentence == "its centre of mass (mx, my, mz over m) at (0.15, 0, 0) m is 0.05 m outside its shape."


def test_mass_spread_beyond_the_ellipsoid_is_told():
    cube = region_of_points(np.array([[i, j, k] for i in (-0.1, 0.1) for j in (-0.1, 0.1) for k in (-0.1, 0.1)]))
    wide = body_parameters(1.0, np.zeros(3), np.eye(3))
    (sentence,) = body_inconsistencies(wide, cube)
    assert "need mass outside the ellipsoid about its shape" in sentence


def test_only_the_broken_body_is_named(arm):
    standard = standard_parameters(arm).copy()
    standard[10] = -1.0
    (sentence,) = inconsistencies(arm, standard)
    assert sentence.startswith(arm.model.names[2]) or ": its mass (m) is -1 kg" in sentence


@pytest.mark.parametrize(
    ("values", "message"),
    [(np.zeros(7), "7 values were given for 3 bodies: give ten"), (np.full(30, np.inf), "not finite")],
)
def test_values_of_another_robot_and_infinite_ones_are_refused(arm, values, message):
    with pytest.raises(ParameterError, match=message):
        inconsistencies(arm, values)
