"""Exciting motions stay within limits and off obstacles."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from identification.excitation.collisions import Collisions, collisions_of, distances
from identification.excitation.design_problem import base_of
from identification.excitation.excite import Excitation, excite
from identification.excitation.limits import FrameBox, Limits, bounds_of, limits_of, stated_limits
from identification.excitation.motion_shapes import FourierSeries
from phantom_dyn.dynamics.dynamics import rigid_body_regressor
from phantom_dyn.errors import ParameterError, RobotError
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Actuator

HINGE = """<robot name="hinge"><link name="base"/><link name="arm"><inertial><origin xyz="0 0 -0.2"/><mass value="1"/>
<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
<joint name="pin" type="{kind}"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>{limit}</joint></robot>"""


def hinge(tmp_path, kind, limit):
    path = tmp_path / "hinge.urdf"
    path.write_text(HINGE.format(kind=kind, limit=limit))
    return load_robot(path)


def test_limits_are_those_of_the_robot_file(planar):
    limits = limits_of(planar)
    np.testing.assert_allclose(limits.lower, [-3, -3])
    np.testing.assert_allclose(limits.upper, [3, 3])
    np.testing.assert_allclose(limits.velocity, [20, 20])
    np.testing.assert_allclose(limits.torque, [40, 20])
    assert np.isinf(limits.acceleration).all()
    assert limits.notes == ()


def test_a_stated_drive_goes_before_the_robot_file(planar):
    weak = replace(planar, actuators=(Actuator(torque_limit=5.0), planar.actuators[1]))
    np.testing.assert_allclose(limits_of(weak).torque, [5, 20])


def test_a_share_is_taken_of_speed_and_torque(planar):
    limits = limits_of(planar, share=0.5)
    np.testing.assert_allclose(limits.velocity, [10, 10])
    np.testing.assert_allclose(limits.torque, [20, 10])


def test_a_wish_does_not_raise_the_speed_of_the_robot(planar):
    np.testing.assert_allclose(limits_of(planar, velocity=[1.0, 50.0]).velocity, [1, 20])


def test_a_continuous_joint_has_no_position_limit(tmp_path):
    limits = limits_of(hinge(tmp_path, "continuous", '<limit effort="5" velocity="2"/>'))
    assert limits.lower.tolist() == [-np.inf]
    assert limits.upper.tolist() == [np.inf]


def test_a_joint_without_a_stated_speed_keeps_a_slow_one_and_says_so(tmp_path):
    limits = limits_of(hinge(tmp_path, "continuous", ""))
    assert limits.velocity.tolist() == [1.0]
    assert limits.notes == (
        "The robot states no torque limit of pin: the torque is not limited there.",
        "The robot states no velocity limit of pin: 1 rad/s is used; give another velocity to change it.",
    )


def test_a_linear_joint_without_a_stated_speed_is_slow_in_metres(spatial):
    limits = limits_of(spatial)
    assert limits.velocity.tolist() == [1.0, 1.0, 0.25]
    assert any("1 rad/s and 0.25 m/s is used" in note for note in limits.notes)


def test_a_given_speed_takes_the_place_of_one_that_is_not_stated(spatial):
    limits = limits_of(spatial, velocity=3.0)
    assert limits.velocity.tolist() == [3.0, 3.0, 3.0]
    assert not any("velocity" in note for note in limits.notes)


def test_passive_joints_of_a_chain_have_limits_too():
    robot = load_robot("phantom_1_5")
    assert len(limits_of(robot).upper) == 5
    labels = bounds_of(robot, limits_of(robot)).labels
    assert "position of elbow" in labels
    assert "torque of elbow" not in labels


def test_coulomb_friction_is_taken_off_the_torque(planar):
    # Known truth: 0.4 and 0.2 N m in the robot file.
    bounds = bounds_of(planar, limits_of(planar))
    assert bounds.upper[bounds.labels.index("torque of shoulder")] == pytest.approx(39.6)
    assert bounds.upper[bounds.labels.index("torque of elbow")] == pytest.approx(19.8)


def test_a_drive_weaker_than_its_friction_is_refused(planar):
    weak = replace(planar, actuators=(Actuator(torque_limit=0.3), planar.actuators[1]))
    with pytest.raises(ParameterError, match=r"The drive of shoulder gives 0\.3, and .* friction alone takes 0\.4"):
        bounds_of(weak, limits_of(weak))


def test_limits_without_room_are_refused(tmp_path):
    robot = hinge(tmp_path, "revolute", '<limit lower="0" upper="0" effort="5" velocity="2"/>')
    with pytest.raises(RobotError, match="lets pin move from 0 to 0, which leaves no room: widen its limits, or hold"):
        limits_of(robot)


def test_zero_and_huge_limits_count_as_none(tmp_path):
    robot = hinge(tmp_path, "revolute", '<limit lower="-1e9" upper="1e9" effort="0" velocity="0"/>')
    stated = stated_limits(robot)
    assert [*stated.lower, *stated.upper, *stated.velocity, *stated.torque] == [-np.inf, np.inf, np.inf, np.inf]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        *(({"share": x}, "of the limits was given: give more than 0 and at most 1") for x in (0.0, 1.5, np.nan)),
        *(
            ({"velocity": x}, "values of velocity were given for 2 joints: give one, or one for each")
            for x in ([1.0, 2.0, 3.0], [])
        ),
        *(
            ({"acceleration": x}, r"An acceleration limit of .* was given: give numbers above 0")
            for x in (0.0, -1.0, np.nan)
        ),
    ],
)
def test_a_share_a_number_of_speeds_or_a_limit_that_is_none_is_refused(planar, given, message):
    with pytest.raises(ParameterError, match=message):
        limits_of(planar, **given)


def test_an_unknown_frame_is_refused_with_the_names(planar):
    box = FrameBox("lowr", np.zeros(3), np.ones(3))
    with pytest.raises(RobotError, match=r"planar2 has no frame 'lowr': the frames are .*; did you mean lower"):
        limits_of(planar, boxes=[box])


def test_an_empty_box_is_refused():
    with pytest.raises(ParameterError, match="give lower corners below upper ones"):
        FrameBox("tip", np.ones(3), np.ones(3))


def test_a_joint_without_a_drive_is_refused(planar):
    idle = replace(planar, actuators=(planar.actuators[0], Actuator(actuated=False)))
    with pytest.raises(RobotError, match=r"elbow of planar2 has no drive that could follow a reference: hold it"):
        limits_of(idle)


def test_limits_of_another_robot_are_refused(planar, spatial):
    with pytest.raises(ParameterError, match="The limits are not those of planar2"):
        bounds_of(planar, limits_of(spatial))


def test_a_speed_of_nan_is_refused():
    with pytest.raises(ParameterError, match="A limit of velocity is not above 0"):
        Limits(np.array([-1.0]), np.ones(1), np.array([np.nan]), np.ones(1), np.ones(1))


def test_the_worst_bound_says_what_is_reached_and_by_how_much(planar):
    bounds = bounds_of(planar, limits_of(planar))
    values = np.zeros((3, len(bounds.labels)))
    values[1, bounds.labels.index("torque of elbow")] = -29.7
    assert bounds.worst(values) == "the torque of elbow reaches -29.7 N m, 9.9 N m under its limit of -19.8 N m"


def test_a_bound_is_reached_within_a_per_cent(planar):
    bounds = bounds_of(planar, limits_of(planar))
    values = np.zeros((3, len(bounds.labels)))
    values[1, bounds.labels.index("velocity of elbow")] = -19.9
    values[1, bounds.labels.index("velocity of shoulder")] = 19.0
    assert bounds.reached(values) == ("velocity of elbow",)


def ball_distance(q: np.ndarray) -> np.ndarray:
    """Closed form: the far ball of three links of 0.5 m in a plane, less both radii."""
    angles = np.cumsum(q, axis=1)
    end = -0.5 * np.stack([np.sin(angles).sum(axis=1), np.cos(angles).sum(axis=1)])
    return np.linalg.norm(end, axis=0) - 0.2


def test_the_distance_of_balls_is_that_of_their_centres_less_their_radii(chain_of_balls, rng):
    collisions = collisions_of(chain_of_balls)
    q = rng.uniform(-2.5, 2.5, (50, 3))
    found, slope = distances(chain_of_balls.model, collisions, q, slopes=False)
    assert collisions.names == ("base_0 and c_0",)
    assert slope is None
    np.testing.assert_allclose(found[:, 0], ball_distance(q), atol=1e-6)


def test_the_slope_of_a_small_distance_is_that_of_the_closed_form(chain_of_balls, rng):
    collisions = collisions_of(chain_of_balls, clearance=10.0)
    q, h = rng.uniform(-2.5, 2.5, (50, 3)), 1e-6
    slope = distances(chain_of_balls.model, collisions, q, slopes=True)[1]
    assert slope is not None
    for joint in range(3):
        step = h * np.eye(3)[joint]
        expected = (ball_distance(q + step) - ball_distance(q - step)) / (2 * h)
        np.testing.assert_allclose(slope[:, 0, joint], expected, atol=1e-6)


def test_neighbours_are_no_pair(chain_of_balls):
    # The base has a joint to link a, which has no shape; base and c are two joints apart.
    pairs = collisions_of(chain_of_balls).shapes.collisionPairs
    assert [(pair.first, pair.second) for pair in pairs] == [(0, 1)]


def test_a_robot_without_shapes_has_a_note(planar):
    collisions = collisions_of(planar)
    assert collisions.names == ()
    assert collisions.notes == ("planar2 has no collision shapes: collisions are not checked.",)


def test_shapes_whose_mesh_is_missing_have_a_note(tmp_path, chain_of_balls):
    text = Path(chain_of_balls.source).read_text().replace('<sphere radius="0.1"/>', '<mesh filename="no.stl"/>')
    path = tmp_path / "missing.urdf"
    path.write_text(text)
    (note,) = collisions_of(load_robot(path)).notes
    assert note.startswith("Collisions are not checked, as the shapes cannot be read (")


@pytest.mark.parametrize("clearance", [-0.1, np.nan])
def test_a_clearance_that_is_none_is_refused(chain_of_balls, clearance):
    with pytest.raises(ParameterError, match=r"The clearance is \S+: give a number of 0 or more"):
        Collisions(collisions_of(chain_of_balls).shapes, clearance)


LINK = (
    '<link name="{name}"><inertial><origin xyz="{middle} 0 0"/><mass value="{mass}"/>'
    '<inertia ixx="1e-5" iyy="{inertia}" izz="{inertia}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
)

JOINT = (
    '<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><origin xyz="{at} 0 0"/>'
    '<axis xyz="0 0 1"/><limit lower="-3.2" upper="3.2" effort="2" velocity="25"/></joint>'
)

# Name, mass and length of each rod: two arms, and the forearms that meet in a pin.
RODS = (("arm_a", 0.3, 0.18), ("forearm_a", 0.2, 0.26), ("arm_b", 0.25, 0.2), ("forearm_b", 0.15, 0.24))

JOINTS = (
    ("drive_a", "revolute", "base", "arm_a", -0.08),
    ("elbow_a", "revolute", "arm_a", "forearm_a", 0.18),
    ("drive_b", "revolute", "base", "arm_b", 0.08),
    ("elbow_b", "revolute", "arm_b", "forearm_b", 0.2),
    ("fixed_a", "fixed", "forearm_a", "pin_a", 0.26),
    ("fixed_b", "fixed", "forearm_b", "pin_b", 0.24),
)

LOOP = (
    "loops:\n  - {kind: point, frame_a: pin_a, frame_b: pin_b, active: [drive_a, drive_b], "
    "start: {drive_a: 2.2, elbow_a: -1.1, drive_b: 0.9, elbow_b: 1.1}}\n"
)


@pytest.fixture(scope="module")
def designed(tmp_path_factory) -> Excitation:
    folder = tmp_path_factory.mktemp("linkage")
    links = [
        LINK.format(name=name, middle=length / 2, mass=mass, inertia=mass * length**2 / 12)
        for name, mass, length in RODS
    ]
    joints = [
        JOINT.format(name=name, kind=kind, parent=parent, child=child, at=at)
        for name, kind, parent, child, at in JOINTS
    ]
    bare = '<link name="base"/><link name="pin_a"/><link name="pin_b"/>'
    (folder / "linkage.urdf").write_text(f'<robot name="linkage">{bare}{"".join(links + joints)}</robot>')
    (folder / "robot.yaml").write_text(LOOP)
    return excite(load_robot(folder / "linkage.urdf"), FourierSeries(4.0, 3), starts=2, seed=2)


@pytest.mark.whole
def test_the_descent_goes_on_where_its_first_steps_tear_the_loop_open(designed):
    # The best of the random starts is what a descent that gives up ends with.
    assert designed.condition < 0.6 * designed.start


@pytest.mark.whole
def test_its_condition_is_that_of_the_normed_columns(designed):
    # Oracle: singular values by NumPy, at a rate that the design has not seen; the columns span all others.
    W = rigid_body_regressor(designed.robot, designed.motion(400.0))
    W = W.reshape(-1, W.shape[2])
    columns = W[:, base_of(designed.robot).columns]
    assert np.linalg.matrix_rank(columns, tol=1e-8) == np.linalg.matrix_rank(W, tol=1e-8) == designed.rank
    stated = np.linalg.cond(columns / np.linalg.norm(columns, axis=0))
    assert designed.condition == pytest.approx(stated, rel=0.05)
