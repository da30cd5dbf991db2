"""Walking of a whole robot."""

# pyright: reportAttributeAccessIssue=false
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest

from phantom_dyn.errors import ParameterError, RobotError
from phantom_dyn.model.robot_files import examples_folder, find_robot
from phantom_dyn.walking.footsteps import Gait, Joystick
from phantom_dyn.walking.pattern import foot_motion, pendulum_motion
from phantom_dyn.walking.walker import G1_POSTURE, G1_SOLE, TALOS_POSTURE, TALOS_SOLE, g1, load_walker, talos
from phantom_dyn.walking.walking_reference import haptic_signal, walk
from phantom_dyn.walking.whole_body import ComMotion, whole_body_motion
from phantom_dyn.walking.zmp import support_polygon

G1_FILE, TALOS_FILE = "example:g1_29dof_rev_1_0", "example:talos_reduced"


@pytest.mark.parametrize("walker", [talos, g1])
def test_the_soles_stand_level_on_the_ground_beside_the_origin(walker):
    biped = walker()
    data = biped.model.createData()
    pin.framesForwardKinematics(biped.model, data, biped.posture)
    for side, y in (("left", biped.foot_distance / 2), ("right", -biped.foot_distance / 2)):
        pose = data.oMf[biped.model.getFrameId(f"{side}_sole")]
        np.testing.assert_allclose(pose.translation, [0, y, 0], atol=5e-4)
        np.testing.assert_allclose(pose.rotation, np.eye(3), atol=2e-3)


@pytest.mark.parametrize(("walker", "file"), [(talos, TALOS_FILE), (g1, G1_FILE)])
def test_the_mass_is_that_of_the_robot_file(walker, file):
    masses = [float(m.get("value", 0)) for m in ElementTree.parse(find_robot(file)).getroot().iter("mass")]
    assert pin.computeTotalMass(walker().model) == pytest.approx(sum(masses))


def test_the_soles_of_g1_are_the_contact_spheres_of_its_file():
    root = ElementTree.parse(find_robot(G1_FILE)).getroot()
    link = next(link for link in root.iter("link") if link.get("name") == G1_SOLE.frame)
    spheres = [shape for shape in link.iter("collision") if shape.find("geometry/sphere") is not None]
    points = np.array([[float(x) for x in shape.find("origin").get("xyz").split()] for shape in spheres])
    radius = {float(shape.find("geometry/sphere").get("radius")) for shape in spheres}
    assert G1_SOLE.below == pytest.approx(-points[0, 2] + radius.pop())
    corners = G1_SOLE.corners + G1_SOLE.middle[:2]
    np.testing.assert_allclose(corners[np.lexsort(corners.T)], points[np.lexsort(points.T[:2]), :2], atol=1e-15)


def test_the_sole_of_talos_lies_in_the_flat_of_its_collision_mesh():
    folder = examples_folder()
    assert folder is not None
    mesh = folder / "talos_data" / "meshes" / "v2" / "ankle_X_collision.stl"
    triangles = np.frombuffer(mesh.read_bytes()[84:], dtype=[("f", "<12f4"), ("pad", "<u2")])["f"]
    vertices = triangles.reshape(-1, 4, 3)[:, 1:].reshape(-1, 3).astype(float)
    flat = vertices[vertices[:, 2] < vertices[:, 2].min() + 2e-3, :2]
    assert support_polygon(flat).margin(TALOS_SOLE.corners + TALOS_SOLE.middle[:2]).min() > -0.01


@pytest.mark.parametrize(
    ("frame", "said"),
    [
        ("left_sole", r"unknown frame 'left_sole'.*did you mean left_sole_link"),
        ("leg_left_4_link", "has 4 joints, and walking needs six"),
    ],
)
def test_a_frame_that_is_not_there_or_on_no_leg_of_six_joints_is_refused(frame, said):
    sole = replace(TALOS_SOLE, frame=frame)
    with pytest.raises(RobotError, match=said):
        load_walker(TALOS_FILE, left=sole, right=sole, posture=TALOS_POSTURE)


def test_a_joint_of_the_posture_that_is_not_there_is_refused():
    with pytest.raises(RobotError, match="unknown joint 'knee'"):
        load_walker(TALOS_FILE, left=TALOS_SOLE, right=TALOS_SOLE, posture={"knee": 1.0})


def test_a_posture_on_its_toes_is_refused():
    bent = dict(G1_POSTURE) | {"left_ankle_pitch_joint": 0.0}
    right = replace(G1_SOLE, frame="right_ankle_roll_link")
    with pytest.raises(RobotError, match=r"not level side by side.*correct the posture"):
        load_walker(G1_FILE, left=G1_SOLE, right=right, posture=bent)


def going(speed, turn=0.0) -> Joystick:
    return Joystick(np.array([0.2]), np.array([speed]), np.array([turn]), np.array([True]))


def placed(points, foot):
    return foot[:2] + points @ np.array([[np.cos(foot[3]), np.sin(foot[3])], [-np.sin(foot[3]), np.cos(foot[3])]])


def test_ten_seconds_with_a_turn_keep_the_zero_moment_point_of_all_bodies_inside_in_every_sample(reference):
    assert len(reference.t) == 1000
    assert reference.left.position[-1, 3] == pytest.approx(0.48)  # the turn: three steps of 0.2 rad/s * 0.8 s
    assert reference.margin.min() > 0.04


def test_a_robot_with_half_as_wide_soles_walks_the_same_command(joystick):
    assert walk(g1(), joystick, duration=10.0, rate=50.0).margin.min() > 0.005


def test_the_soles_never_overlap_at_the_largest_turn_of_the_standard_gait(biped):
    turning = walk(biped, going(0.15, 0.24), duration=5.0, rate=25.0)
    sides = zip(biped.corners, np.roll(biped.corners, 1, axis=0), strict=True)
    outline = np.concatenate([np.linspace(start, end, 20) for start, end in sides])
    for left, right in zip(turning.left.position, turning.right.position, strict=True):
        assert support_polygon(placed(biped.corners, left)).margin(placed(outline, right)).max() < -0.01


def test_joints_stay_within_their_speed_limits(biped, reference):
    speed = np.abs(reference.motion.v[:, 6:]).max(axis=0)
    assert (speed < biped.model.velocityLimit[6:]).all()


def test_the_planned_zero_moment_point_misses_the_swing_of_the_leg_by_centimetres(reference):
    # The pendulum has no angular momentum: this is why the margin is taken of all bodies.
    miss = np.linalg.norm(reference.zmp - reference.pendulum.zmp, axis=1)
    assert 0.02 < miss.max() < 0.06


def test_standing_has_the_margin_of_a_point_between_the_soles(biped):
    # Closed form: the middle of the hull of both soles is as far from its front edge as half a sole is long.
    still = walk(biped, Joystick(*np.zeros((3, 1)), np.array([False])), duration=0.1)
    np.testing.assert_allclose(still.margin, 0.10, atol=1e-9)
    assert len(still.polygons) == 1


def test_polygons_change_at_each_lift_and_each_landing(reference):
    assert len(reference.polygons) == 1 + 2 * len(reference.landings)


def test_faster_steps_leave_less_margin_and_the_hand_feels_it(biped):
    quick = Gait(foot_distance=biped.foot_distance, single_support=0.3, double_support=0.1, longest_step=0.4)
    slow, fast = (walk(biped, going(v, 0.2), duration=3.0, rate=50.0, gait=quick) for v in (0.1, 0.3))
    assert fast.margin.min() < 0 < slow.margin.min()
    assert fast.haptic_signal(silent_above=0.04).max() == 1.0
    assert slow.haptic_signal(silent_above=0.04).max() < 0.5


def test_the_haptic_signal_rises_in_a_line_as_the_margin_goes():
    margin = np.array([0.08, 0.04, 0.03, 0.01, 0.0, -0.1])
    np.testing.assert_allclose(haptic_signal(margin, silent_above=0.04), [0, 0, 0.25, 0.75, 1, 1], atol=1e-15)


def test_a_haptic_signal_that_is_never_silent_is_refused():
    with pytest.raises(ParameterError, match="silent above a margin of 0 m: give more than 0"):
        haptic_signal(np.zeros(1), silent_above=0.0)


def test_a_walk_without_a_sample_is_refused(biped):
    with pytest.raises(ParameterError, match="A walk of 0 s at 100 Hz has no sample"):
        walk(biped, going(0.1), duration=0.0)


@pytest.fixture(scope="module")
def neighbours(biped, reference):
    """Whole-body motion at one time in a turning swing phase and shortly before and after it."""
    step = 1e-5
    t = 4.43 + step * np.array([-1.0, 0.0, 1.0])
    omega = np.sqrt(9.81 / biped.com_height)
    states = pendulum_motion(reference.phases, t, omega)
    level = np.zeros((3, 1))
    com = ComMotion(
        np.hstack([states.com, level + biped.com_height]),
        np.hstack([states.velocity, level]),
        np.hstack([states.acceleration, level]),
    )
    left, right = (foot_motion(reference.phases, t, side, 0.04) for side in ("left", "right"))
    return step, whole_body_motion(biped, com, left, right)


def test_centre_of_mass_and_soles_are_where_they_were_wanted(biped, reference):
    data = biped.model.createData()
    for k in range(0, len(reference.t), 20):
        com = pin.centerOfMass(biped.model, data, reference.motion.q[k])
        np.testing.assert_allclose(com, [*reference.pendulum.com[k], biped.com_height], atol=1e-9)
        pin.framesForwardKinematics(biped.model, data, reference.motion.q[k])
        for side in ("left", "right"):
            pose, wanted = data.oMf[biped.model.getFrameId(f"{side}_sole")], getattr(reference, side).position[k]
            np.testing.assert_allclose(pose.translation, wanted[:3], atol=1e-9)
            np.testing.assert_allclose(pin.rpy.matrixToRpy(pose.rotation), [0, 0, wanted[3]], atol=1e-9)


def test_velocities_are_the_differences_of_configurations(biped, neighbours):
    # Oracle: central differences on the manifold of configurations.
    step, motion = neighbours
    numeric = pin.difference(biped.model, motion.q[0], motion.q[2]) / (2 * step)
    np.testing.assert_allclose(motion.v[1], numeric, atol=1e-5)


def test_accelerations_are_the_differences_of_velocities(neighbours):
    step, motion = neighbours
    np.testing.assert_allclose(motion.a[1], (motion.v[2] - motion.v[0]) / (2 * step), atol=1e-4)


def test_joints_that_do_not_walk_keep_the_posture(biped, reference):
    walking = [k for k in biped.leg_columns if k >= 6]
    still = np.setdiff1d(np.arange(6, biped.model.nv), walking)
    np.testing.assert_allclose(reference.motion.q[:, still + 1], np.tile(biped.posture[still + 1], (1000, 1)), atol=0)
    np.testing.assert_array_equal(reference.motion.v[:, still], 0.0)


def test_steps_beyond_the_reach_of_the_legs_are_refused(biped):
    gait = Gait(foot_distance=biped.foot_distance, longest_step=2.0)
    one = np.array([0.0])
    with pytest.raises(ParameterError, match="slower or shorter step"):
        walk(biped, Joystick(one, one + 1.2, one, np.array([True])), duration=4.0, gait=gait, rate=20.0)
