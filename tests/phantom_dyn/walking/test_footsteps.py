"""Footsteps, stairs, joystick and support polygons."""

import math

import numpy as np
import pytest

from phantom_dyn.errors import ParameterError
from phantom_dyn.walking.footsteps import Command, Gait, Joystick, closed, other, standing, stepped
from phantom_dyn.walking.stairs import StairReference, Stairs, climb, zmp_on_slope
from phantom_dyn.walking.walker import Walker, talos_bent
from phantom_dyn.walking.zmp import support_polygon, support_polygon_along, zmp_of_wrench

GAIT = Gait(foot_distance=0.2)


def walked(command, steps):
    stance, swing = standing(GAIT), "right"
    for _ in range(steps):
        stance, swing = stepped(stance, swing, command, GAIT), other(swing)
    return stance, swing


def test_straight_steps_advance_the_body_by_speed_times_step_time():
    stance, _ = walked(Command(0.1, 0.0, True), 4)
    assert (stance.body.x, stance.left.x, stance.right.x) == pytest.approx((0.32, 0.32, 0.24))
    assert (stance.left.y, stance.right.y) == pytest.approx((0.1, -0.1))


def test_steps_with_a_turn_lie_on_a_circle():
    # Closed form: chords of length c that turn by w each lie on a circle of radius c / (2 sin(w / 2)).
    command = Command(0.1, 0.2, True)
    chord, turn = 0.1 * GAIT.step_time, 0.2 * GAIT.step_time
    centre = np.array([0.0, chord / (2 * np.sin(turn / 2))])
    for steps in range(1, 9):
        body = walked(command, steps)[0].body
        assert np.linalg.norm(body.point - centre) == pytest.approx(centre[1])
        assert body.heading == pytest.approx(steps * turn)


def test_the_last_step_puts_the_foot_beside_the_other():
    stance, swing = walked(Command(0.1, 0.2, True), 3)
    last = closed(stance, swing, GAIT)
    assert last.left.heading == last.right.heading
    assert last.foot(other(swing)) == stance.foot(other(swing))
    across = last.left.point - last.right.point
    heading = last.left.heading
    np.testing.assert_allclose(across, 0.2 * np.array([-np.sin(heading), np.cos(heading)]), atol=1e-15)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        pytest.param(
            lambda: stepped(standing(GAIT), "left", Command(1.0, 0.0, True), GAIT),
            r"asks for an advance of 0.8 m in a step, more than the gait's 0.15 m",
            id="a longer step than the gait has",
        ),
        pytest.param(
            lambda: stepped(standing(GAIT), "left", Command(0.0, -1.0, True), GAIT),
            r"asks for a turn of -0.8 rad in a step, more than the gait's 0.2 rad",
            id="a larger turn than the gait has",
        ),
        pytest.param(
            lambda: Gait(foot_distance=0.2, double_support=0.0),
            "double support of the gait is 0.0: give a number above 0",
            id="a gait with no time on both feet",
        ),
        pytest.param(
            lambda: Joystick(np.array([1.0]), np.array([np.inf]), np.array([0.0]), np.array([True])),
            "joystick's speed has a value that is not finite",
            id="a speed that is no number",
        ),
        pytest.param(
            lambda: support_polygon_along(np.column_stack([CORNERS, np.zeros(4)]), np.array([0.0, 0.0, -1.0])),
            "does not press",
            id="a force that pulls has no polygon",
        ),
        pytest.param(lambda: Stairs(0.0, math.nan), "give a length above 0", id="stairs without a tread"),
        pytest.param(
            lambda: support_polygon(np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]])),
            "lie on one line: give points that span an area",
            id="contact points on a line",
        ),
        pytest.param(
            lambda: support_polygon(SQUARE[:2]), "of 2 contact points: give three or more", id="two contact points"
        ),
        pytest.param(
            lambda: support_polygon(np.array([[0.0, 0.0], [1.0, np.nan], [2.0, 2.0]])),
            "not finite: give numbers in metres",
            id="a contact point that is no number",
        ),
    ],
)
def test_what_cannot_be_is_refused(call, message):
    with pytest.raises(ParameterError, match=message):
        call()


@pytest.fixture
def stick():
    walking = np.array([True, False, True])
    return Joystick(np.array([1.0, 2.0, 4.0]), np.array([0.1, 0.2, 0.3]), np.array([0.0, 0.1, 0.2]), walking)


def test_what_was_set_holds_until_the_next_change(stick):
    assert stick.at(1.0) == Command(0.1, 0.0, True)
    assert stick.at(1.999) == Command(0.1, 0.0, True)
    assert stick.at(3.0) == Command(0.2, 0.1, False)
    assert stick.at(100.0) == Command(0.3, 0.2, True)


def test_before_the_first_change_the_robot_stands(stick):
    assert stick.at(0.999) == Command(0.0, 0.0, False)


def test_the_next_start_is_now_while_walking_and_the_next_press_otherwise(stick):
    assert stick.next_start(1.5) == 1.5
    assert stick.next_start(0.0) == 1.0
    assert stick.next_start(2.5) == 4.0


def test_there_is_no_next_start_after_the_last_stop():
    one = np.array([1.0])
    assert Joystick(one, one, one, np.array([False])).next_start(0.0) is None


def test_times_that_do_not_increase_are_refused():
    two = np.array([1.0, 1.0])
    with pytest.raises(ParameterError, match="times must increase"):
        Joystick(two, two, two, np.array([True, False]))


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


def test_it_ends_with_both_feet_on_the_last_tread(reference):
    ends = [foot.position[-1, [0, 2]] for foot in (reference.left, reference.right)]
    np.testing.assert_allclose(ends, np.tile([4 * 0.22, 4 * reference.stairs.rise], (2, 1)), atol=1e-12)


def test_no_sole_runs_into_an_edge(reference):
    assert reference.clearance.min() > -1e-9


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


@pytest.mark.parametrize(
    ("tread", "steps", "said"),
    [(0.15, 3, "give treads that are longer"), (0.22, 1, "give a whole number of 2 or more")],
)
def test_treads_shorter_than_a_sole_and_one_step_are_refused(walker, tread, steps, said):
    with pytest.raises(ParameterError, match=said):
        climb(walker, Stairs(tread, 0.05), steps)


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
    assert (polygon.margin(edge) >= 0).all()


def test_two_feet_span_the_ground_between_them():
    # Closed form: two soles of 0.2 x 0.1 m at y = +-0.1 m; each alone does not hold the origin.
    sole = np.array([[0.1, 0.05], [0.1, -0.05], [-0.1, 0.05], [-0.1, -0.05]])
    aside = np.array([0.0, 0.1])
    left, right = sole + aside, sole - aside
    origin = np.zeros((1, 2))
    assert support_polygon(left).margin(origin) == pytest.approx(-0.05)
    assert support_polygon(np.vstack([left, right])).margin(origin) == pytest.approx(0.1)
