import dataclasses

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from phantom_dyn import load_robot
from phantom_dyn.dynamics.dynamics import standard_parameters
from phantom_dyn.model.inertia import (
    STANDARD_NAMES,
    body_parameters,
    breaks_triangle,
    central_parameters,
    impossible_because,
    parameter_names,
    parameter_units,
    tolerance_directions,
)
from places import ROBOTS

ENTRIES = [(0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2)]
vectors = arrays(float, 3, elements=st.floats(-1, 1))
matrices = arrays(float, (3, 3), elements=st.floats(-1, 1))


def test_parameters_carry_the_names_of_the_moving_links():
    names = parameter_names(load_robot(ROBOTS / "arm3.urdf"))
    assert names[:20:10] == ("column.m", "beam.m")
    assert names[20:] == tuple(f"rail.{name}" for name in STANDARD_NAMES)


def test_a_locked_joint_leaves_the_name_of_the_link_that_carries_it(tmp_path):
    (tmp_path / "c.yaml").write_text("lock: [tilt]")
    names = parameter_names(load_robot(ROBOTS / "arm3.urdf", config=tmp_path / "c.yaml"))
    assert names[::10] == ("column.m", "rail.m")


def test_every_parameter_has_a_unit():
    robot = load_robot(ROBOTS / "arm3.urdf")
    assert parameter_units(robot)[9:12] == ("kg m^2", "kg", "kg m")


def test_names_stand_in_the_order_of_pinocchio():
    # Known truth: one entry of each kind, separated by its value.
    inertia = pin.Inertia(2.0, np.array([0.1, 0.2, 0.3]), np.diag([1.0, 1.1, 1.2]))
    named = dict(zip(STANDARD_NAMES, inertia.toDynamicParameters(), strict=True))
    expected = inertia.inertia + 2 * (0.14 * np.eye(3) - np.outer([0.1, 0.2, 0.3], [0.1, 0.2, 0.3]))
    assert [named["mz"], named["Ixz"], named["Iyy"]] == pytest.approx([0.6, expected[0, 2], expected[1, 1]])


@settings(deadline=None)
@given(mass=st.floats(0.01, 100), center=vectors, square=matrices)
def test_standard_parameters_round_trip(mass, center, square):
    inertia = square @ square.T
    back = central_parameters(body_parameters(mass, center, inertia))
    assert back[0] == mass
    np.testing.assert_allclose(back[1], center, atol=1e-12)
    np.testing.assert_allclose(back[2], inertia, atol=1e-11)


@settings(deadline=None)
@given(mass=st.floats(0.01, 100), center=vectors, square=matrices)
def test_standard_parameters_are_those_of_pinocchio(mass, center, square):
    inertia = square @ square.T
    expected = pin.Inertia(mass, center, inertia).toDynamicParameters()
    np.testing.assert_allclose(body_parameters(mass, center, inertia), expected, atol=1e-11)


def test_a_body_without_mass_has_its_centre_at_the_origin():
    assert central_parameters(np.zeros(10))[1].tolist() == [0, 0, 0]


@pytest.mark.parametrize("joint_index", [1, 2, 3])
@pytest.mark.parametrize("column", range(10))
def test_tolerance_directions_are_finite_differences(joint_index, column):
    robot = load_robot(ROBOTS / "arm3.urdf")
    standard = standard_parameters(robot)[10 * (joint_index - 1) : 10 * joint_index]

    def changed(delta: float) -> np.ndarray:
        mass, center, inertia = central_parameters(standard)
        center, inertia = center.copy(), inertia.copy()
        if column == 0:
            mass *= 1 + delta
        elif column <= 3:
            center[column - 1] += delta * np.linalg.norm(center)
        else:
            i, j = ENTRIES[column - 4]
            inertia[i, j] += delta * np.sqrt(inertia[i, i] * inertia[j, j])
            inertia[j, i] = inertia[i, j]
        return body_parameters(mass, center, inertia)

    slope = (changed(1e-6) - changed(-1e-6)) / 2e-6
    np.testing.assert_allclose(tolerance_directions(robot, joint_index)[0][:, column], slope, atol=1e-8)


def test_tolerance_directions_are_named_by_link_and_quantity():
    names = tolerance_directions(load_robot(ROBOTS / "arm3.urdf"), 2)[1]
    assert (names[0], names[1], names[9]) == ("beam mass", "beam center x", "beam Izz")


def test_a_centre_of_mass_on_the_joint_origin_has_no_relative_change():
    directions, _ = tolerance_directions(load_robot("emps"), 1)
    assert not directions[:, 1:4].any()


def test_a_body_without_mass_has_no_relative_change():
    robot = load_robot(ROBOTS / "pendulum.urdf")
    model = robot.model.copy()
    model.inertias[1] = pin.Inertia.Zero()
    assert not tolerance_directions(dataclasses.replace(robot, model=model), 1)[0].any()


def test_a_negative_principal_inertia_behind_positive_diagonal_entries_is_impossible():
    inertia = np.array([[1.0, 2, 0], [2, 1, 0], [0, 0, 5]])
    assert impossible_because(1.0, inertia) == "its smallest principal inertia is -1 kg m^2, below zero"


@pytest.mark.parametrize(
    ("mass", "inertia", "why"),
    [
        (2.0, np.diag([0.1, 0.1, 0.01]), None),
        (-2.0, np.eye(3), "its mass is -2 kg, below zero"),
        (np.nan, np.eye(3), "its inertia is not a finite number"),
        # Rounding below zero, and rounding errors that are written for zero.
        (1.0, np.diag([1.0, 1.0, -1e-10]), None),
        (0.5, np.diag([1e-35, 0.0, -2.4e-35]), None),
    ],
)
def test_a_body_of_mass_and_inertia_above_zero_but_for_rounding_is_possible(mass, inertia, why):
    assert impossible_because(mass, inertia) == why


@pytest.mark.parametrize(("largest", "broken"), [(3.0, False), (3.01, True)])
def test_one_principal_value_above_the_sum_of_the_others_breaks_the_triangle_inequality_and_that_sum_not(
    largest, broken
):
    assert breaks_triangle(np.diag([1.0, 2.0, largest])) == broken
