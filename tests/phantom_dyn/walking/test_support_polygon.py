from __future__ import annotations

import numpy as np
import pytest

from phantom_dyn.errors import ParameterError
from phantom_dyn.walking.zmp import support_polygon

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def test_the_margin_inside_a_unit_square_is_the_distance_to_the_nearest_side():
    inside = np.array([[0.5, 0.5], [0.1, 0.5], [0.6, 0.95]])
    np.testing.assert_allclose(support_polygon(SQUARE).margin(inside), [0.5, 0.1, 0.05], atol=1e-15)


def test_the_margin_outside_is_minus_the_distance_to_side_or_corner():
    outside = np.array([[0.5, -0.2], [1.3, 1.4], [-3.0, -4.0]])
    np.testing.assert_allclose(support_polygon(SQUARE).margin(outside), [-0.2, -0.5, -5.0], atol=1e-15)


def test_a_point_on_the_boundary_is_inside_with_no_margin():
    polygon = support_polygon(SQUARE)
    edge = np.array([[0.5, 0.0], [1.0, 1.0]])
    np.testing.assert_allclose(polygon.margin(edge), 0.0, atol=1e-15)
    assert polygon.contains(edge).all()


def test_the_corners_run_counter_clockwise(rng):
    corners = support_polygon(rng.normal(size=(30, 2))).vertices
    edges = np.roll(corners, -1, axis=0) - corners
    following = np.roll(edges, -1, axis=0)
    assert (edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0] > 0).all()


def test_random_convex_combinations_are_inside_and_far_points_are_not(rng):
    contacts = rng.normal(size=(12, 2))
    polygon = support_polygon(contacts)
    assert polygon.contains(rng.dirichlet(np.ones(12), 200) @ contacts).all()
    angle = rng.uniform(0, 2 * np.pi, 50)
    reach = 1.01 * np.linalg.norm(contacts, axis=1).max()
    assert not polygon.contains(reach * np.stack([np.cos(angle), np.sin(angle)], axis=1)).any()


def test_two_feet_span_the_ground_between_them():
    # Closed form: two soles of 0.2 x 0.1 m at y = +-0.1 m; each alone does not hold the origin.
    sole = np.array([[0.1, 0.05], [0.1, -0.05], [-0.1, 0.05], [-0.1, -0.05]])
    aside = np.array([0.0, 0.1])
    left, right = sole + aside, sole - aside
    origin = np.zeros((1, 2))
    assert support_polygon(left).margin(origin) == pytest.approx(-0.05)
    assert support_polygon(np.vstack([left, right])).margin(origin) == pytest.approx(0.1)


def test_contact_points_on_a_line_are_refused():
    with pytest.raises(ParameterError, match="lie on one line: give points that span an area"):
        support_polygon(np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]]))


def test_two_contact_points_are_refused():
    with pytest.raises(ParameterError, match="of 2 contact points: give three or more"):
        support_polygon(SQUARE[:2])


def test_a_contact_point_that_is_no_number_is_refused():
    with pytest.raises(ParameterError, match="not finite: give numbers in metres"):
        support_polygon(np.array([[0.0, 0.0], [1.0, np.nan], [2.0, 2.0]]))
