"""Walking over stairs: closed forms of the pendulum on a slope, parallel contact forces, and a whole robot."""

from __future__ import annotations

import math

import numpy as np
import pytest

from phantom_dyn.errors import ParameterError
from phantom_dyn.walking.stairs import StairReference, Stairs, climb, zmp_on_slope
from phantom_dyn.walking.walker import Walker, talos_bent
from phantom_dyn.walking.zmp import support_polygon, support_polygon_along, zmp_of_wrench

CORNERS = np.array([[0.1, -0.06], [0.1, 0.06], [-0.1, 0.06], [-0.1, -0.06]])


@pytest.fixture(scope="module")
def walker() -> Walker:
    return talos_bent()


@pytest.fixture(scope="module", params=[0.05, -0.05], ids=["up", "down"])
def reference(request, walker) -> StairReference:
    return climb(walker, Stairs(0.22, request.param), 4)


@pytest.mark.parametrize("slope", [0.0, 0.4, -0.3])
def test_on_a_slope_the_pendulum_has_the_law_of_level_ground(slope, rng):
    """Closed form: x - (h/g) x'' of a point mass in a plane h over the slope, whatever the slope."""
    h, x, y, ax, ay = 0.8, *rng.uniform(-0.3, 0.3, (4, 20))
    place = np.column_stack([x, y, slope * x + h])
    force = np.column_stack([ax, ay, slope * ax + 9.81])
    found = zmp_on_slope(force, np.cross(place, force), slope)
    np.testing.assert_allclose(found[:, 0], x - h / 9.81 * ax, atol=1e-12)
    np.testing.assert_allclose(found[:, 2], slope * found[:, 0], atol=1e-12)


def test_forces_along_the_contact_force_reach_every_point_of_the_polygon_and_no_other(rng):
    """Oracle: parallel forces of chosen shares at the corners of two soles at two heights."""
    contacts = np.vstack(
        [np.column_stack([CORNERS + np.array([x, y]), np.full(4, z)]) for x, y, z in ((0, 0.1, 0.0), (0.2, -0.1, 0.07))]
    )
    for _ in range(50):
        force = np.array([*rng.uniform(-200, 200, 2), rng.uniform(500, 1000)])
        shares = rng.dirichlet(np.full(8, 0.3))
        polygon = support_polygon_along(contacts, force)
        moment = np.sum([share * np.cross(c, force) for share, c in zip(shares, contacts, strict=True)], axis=0)
        assert polygon.margin(zmp_of_wrench(force[None], moment[None]))[0] >= -1e-12
        # Beyond the corner that lies farthest along a direction there is no share that reaches.
        turn = rng.uniform(0, 2 * math.pi)
        along = np.array([math.cos(turn), math.sin(turn), 0.0])
        seen = contacts[:, :2] - contacts[:, 2:] * force[:2] / force[2]
        beyond = contacts[np.argmax(seen @ along[:2])] + 0.05 * along
        outside = polygon.margin(zmp_of_wrench(force[None], np.cross(beyond, force)[None]))[0]
        assert -0.05 - 1e-12 <= outside < 0


def test_of_soles_of_one_height_it_is_the_polygon_in_their_plane(rng):
    contacts = np.vstack([CORNERS, CORNERS + np.array([0.3, 0.2])])
    force, place = np.array([60.0, -40.0, 800.0]), np.array([0.1, 0.05, 0.9])
    flat = support_polygon(contacts).margin(zmp_of_wrench(force[None], np.cross(place, force)[None], ground=0.3))
    along = support_polygon_along(np.column_stack([contacts, np.full(8, 0.3)]), force)
    np.testing.assert_allclose(along.margin(zmp_of_wrench(force[None], np.cross(place, force)[None])), flat, atol=1e-12)


def test_a_force_that_pulls_has_no_polygon():
    with pytest.raises(ParameterError, match="does not press"):
        support_polygon_along(np.column_stack([CORNERS, np.zeros(4)]), np.array([0.0, 0.0, -1.0]))


def test_it_ends_with_both_feet_on_the_last_tread(reference):
    ends = [foot.position[-1, [0, 2]] for foot in (reference.left, reference.right)]
    np.testing.assert_allclose(ends, np.tile([4 * 0.22, 4 * reference.stairs.rise], (2, 1)), atol=1e-12)


def test_no_sole_runs_into_an_edge(reference):
    assert reference.clearance.min() > -1e-9


def test_the_zero_moment_point_of_all_bodies_stays_in_the_support_polygon(reference):
    assert reference.margin.min() > 0.04


def test_the_page_states_the_margin_on_the_way_up(reference):
    """docs/haptics.md; on the way down it is 51 mm."""
    expected = 52 if reference.stairs.rise > 0 else 51
    assert round(1e3 * reference.margin.min()) == expected


def test_the_zero_moment_point_of_all_bodies_is_near_the_plan(reference):
    """The plan is that of a point mass: legs that swing two treads move it by some centimetres."""
    assert np.abs(reference.zmp[:, :2] - reference.pendulum.zmp).max() < 0.045


@pytest.mark.parametrize("part", ["left", "right", "com"])
def test_velocity_and_acceleration_are_the_derivatives_of_the_position(reference, part):
    motion = getattr(reference, part)
    for value, rate in ((motion.position, motion.velocity), (motion.velocity, motion.acceleration)):
        steps = np.diff(value, axis=0) / np.diff(reference.t)[:, None]
        middle = 0.5 * (rate[1:] + rate[:-1])
        np.testing.assert_allclose(steps, middle, atol=0.012 * max(1.0, np.abs(rate).max()))


def test_on_level_treads_the_margin_is_that_of_level_ground(walker):
    """Oracle: the polygon of both soles on the ground, and the zero moment point there."""
    level = climb(walker, Stairs(0.22, 0.0), 2)
    k = len(level.t) // 3
    feet = [CORNERS + foot.position[k, :2] for foot in (level.left, level.right) if foot.contact[k]]
    margin = support_polygon(np.vstack(feet)).margin(level.zmp[k : k + 1, :2])[0]
    assert level.margin[k] == pytest.approx(margin, abs=1e-12)


def test_treads_shorter_than_a_sole_are_refused(walker):
    with pytest.raises(ParameterError, match="give treads that are longer"):
        climb(walker, Stairs(0.15, 0.05), 3)


def test_one_step_is_refused(walker):
    with pytest.raises(ParameterError, match="give a whole number of 2 or more"):
        climb(walker, Stairs(0.22, 0.05), 1)


def test_stairs_without_a_tread_are_refused():
    with pytest.raises(ParameterError, match="give a length above 0"):
        Stairs(0.0, math.nan)
