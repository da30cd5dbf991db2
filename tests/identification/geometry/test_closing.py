"""Equations that close a chain."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from identification.data.recording import Recording
from identification.geometry.equations import DELAY, Estimate, PoseProblem, changed_model, equations, nuisances_of
from identification.geometry.fit import frame_poses, start_of, stepped
from identification.geometry.measured import measured_poses
from identification.geometry.pins import KnownPlaces, closed_positions, loops_of
from identification.geometry.terms import BASE_POSE, ELASTIC, LINK, TOOL_POSE, ZERO, PoseTerm, pose_terms, terms_of
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Robot
from places import ROBOTS
from tests.common.measured_poses import link_poses, moved_joint
from tests.common.tracked_chains import TrueChain, linkages

LINKAGES = linkages()

NAMES = [*LINKAGES, "delta"]


def robot_of(name: str) -> Robot:
    if name == "delta":
        return load_robot(ROBOTS / "delta.xml", config=ROBOTS / "delta.yaml")
    return LINKAGES[name].robot


def problem_at(robot: Robot, frame: str, q: np.ndarray) -> PoseProblem:
    """Poses that are what the model predicts."""
    n = len(q)
    still = Recording(
        "p.csv",
        robot.joint_names,
        np.arange(float(n)),
        q,
        None,
        positions={frame: np.zeros((n, 3))},
        orientations={frame: np.tile([0.0, 0.0, 0.0, 1.0], (n, 1))},
    )
    loops = loops_of(robot)
    sets, paths = measured_poses(robot, (still,))
    terms = pose_terms(BASE_POSE, None) + pose_terms(TOOL_POSE, frame) + terms_of(robot, [frame], loops)
    problem = PoseProblem(robot, sets, paths, terms, in_root=True, on_frame=(frame,), loops=loops)
    (one,) = sets
    poses = frame_poses(problem, one)
    turns = np.array([pin.Quaternion(np.array(pose[:3, :3])).coeffs() for pose in poses])
    return replace(problem, sets=(replace(one, position=poses[:, :3, 3], turn=turns),))


@pytest.mark.parametrize("name", NAMES)
def test_columns_are_slopes_through_the_loops(name, rng):
    robot = robot_of(name)
    linkage = LINKAGES.get(name)
    middle, span, frame = (0.0, 0.3, "tip") if linkage is None else (linkage.middle, linkage.span, linkage.frame)
    q = np.array(middle) + np.array(span) * rng.uniform(-1, 1, (6, robot.nv))
    problem = problem_at(robot, frame, q)
    start = start_of(problem)
    found, step = equations(problem, start), 1e-6
    assert np.abs(found.residual).max() < 1e-12
    for k, term in enumerate(problem.terms):
        size = step * (1e-1 if term.effect == ELASTIC else 1.0)
        way = size * (np.arange(len(problem.terms)) == k)
        up, down = (equations(problem, replace(start, values=sign * way)).residual for sign in (1, -1))
        scale = max(1.0, np.abs(found.columns[:, k]).max())
        np.testing.assert_allclose((down - up) / (2 * size), found.columns[:, k], atol=2e-6 * scale, err_msg=str(term))


def _at(names: dict[tuple[str, str], float], terms: tuple[PoseTerm, ...]) -> np.ndarray:
    return np.array([names.get((str(term.joint), term.parameter), 0.0) * (term.effect == LINK) for term in terms])


@pytest.mark.parametrize(
    ("name", "true", "named", "axis"),
    [
        ("phantom", "elbow", "elbow", 2),
        ("phantom", "forearm_to_pin_f", "forearm_to_parallel_link", 1),
        ("phantom", "parallel_link_to_pin_p", "parallel_link_to_forearm", 2),
        ("cea", "q6", "q6", 0),
        ("cea", "q8", "pin3", 0),
        ("fourbar", "rocker_to_pin", "rocker_pin", 2),
        ("fivebar", "right", "right", 0),
    ],
)
def test_a_frame_is_where_a_link_of_another_length_puts_it(name, true, named, axis, rng):
    linkage = LINKAGES[name]
    q = np.array(linkage.middle) + np.array(linkage.span) * rng.uniform(-1, 1, (5, len(linkage.middle)))
    problem = problem_at(linkage.robot, linkage.frame, q)
    values = _at({(named, "xyz"[axis]): 0.003}, problem.terms)
    assert np.count_nonzero(values) == 1
    left = equations(problem, replace(start_of(problem), values=values)).residual.reshape(-1, 6)
    text = moved_joint(linkage.text, true, 0.003 * np.eye(3)[axis])
    truth, given = TrueChain(linkage, text), TrueChain(linkage, linkage.text)
    joints = linkage.robot.joint_names
    for row, error in zip(q, left, strict=True):
        there, here = (
            one.frames(dict(zip(joints, map(float, row), strict=True)))[linkage.frame] for one in (truth, given)
        )
        np.testing.assert_allclose(error[:3], there[:3, :3].T @ (here - there)[:3, 3], atol=1e-8)


def test_loops_that_cannot_close_are_left_as_near_as_they_come(rng):
    # A rocker that is shifted out of the plane: the pins stay a millimetre apart, across it.
    robot = LINKAGES["fourbar"].robot
    loops = loops_of(robot)
    assert loops is not None
    loops.model.jointPlacements[3].translation += np.array([0, 1e-3, 0])
    q = rng.uniform(-3, 3, (4, 1))
    near = robot.solutions.at(q).x
    np.testing.assert_allclose(closed_positions(loops, q, near), near, atol=1e-9)


def test_the_pins_of_a_parallelogram_are_found_and_those_of_the_file_used():
    names = {name: loops_of(robot_of(name)) for name in ("phantom", "cea")}
    phantom, cea = names["phantom"], names["cea"]
    assert phantom is not None
    assert cea is not None
    assert (phantom.names, cea.names) == (("forearm_to_parallel_link", "parallel_link_to_forearm"), ("pin3", "pin6"))
    ends = [phantom.model.frames[frame].placement.translation for frame in phantom.pins]
    # Dimensions of the device: the crank's arm and the upper arm.
    np.testing.assert_allclose(ends, [(0, -0.0325, 0), (0, 0, 0.215)], atol=1e-9)


def test_a_formula_that_no_pin_holds_stays(tmp_path):
    config = tmp_path / "robot.yaml"
    config.write_text("loops: [{kind: linear, active: [shoulder], passive: {elbow: -shoulder}}]\n")
    loops = loops_of(load_robot(ROBOTS / "planar2.urdf", config=config))
    assert loops is not None
    assert (loops.pins, loops.chain.unknowns) == ((), ())


def test_a_zero_moves_the_joints_that_follow_by_a_formula(tmp_path):
    # Closed form: the forearm keeps its direction, so that the tip moves as the elbow does.
    config = tmp_path / "robot.yaml"
    config.write_text("loops: [{kind: linear, active: [shoulder], passive: {elbow: -shoulder}}]\n")
    robot = load_robot(ROBOTS / "planar2.urdf", config=config)
    frame = robot.model.frames[robot.model.nframes - 1].name
    problem = problem_at(robot, frame, np.array([[0.3], [-0.7]]))
    zero = next(k for k, term in enumerate(problem.terms) if term.effect == ZERO)
    found = equations(problem, start_of(problem)).columns[:, zero].reshape(-1, 6)
    assert np.abs(found[:, 3:]).max() < 1e-12
    elbow = np.linalg.norm(robot.model.jointPlacements[2].translation)
    np.testing.assert_allclose(np.linalg.norm(found[:, :3], axis=1), elbow, atol=1e-9)


def test_passive_joints_of_a_loop_have_neither_zeros_nor_elasticity():
    robot = robot_of("fivebar")
    terms = terms_of(robot, ["tip"], loops_of(robot))
    assert {term.joint for term in terms if term.effect in (ZERO, ELASTIC)} == {"left", "right"}
    places = {term.joint for term in terms if term.effect == LINK}
    assert places == {"left", "right", "left_elbow", "right_elbow", "left_pin", "right_pin"}


def test_a_frame_before_the_loops_has_no_terms_of_them():
    robot = robot_of("phantom")
    terms = terms_of(robot, ["shoulder"], loops_of(robot))
    assert {term.joint for term in terms} == {"theta1"}


def test_known_places_are_where_terms_would_put_them():
    robot = robot_of("fourbar")
    twists = {"rocker": np.array([0.001, 0, 0, 0, 0, 0]), "rocker_pin": np.array([0, 0, 0.002, 0, 0, 0])}
    known, given = loops_of(robot, KnownPlaces(twists)), loops_of(robot)
    assert known is not None
    assert given is not None
    terms = terms_of(robot, ["coupler_pin"], given)
    moved_to = changed_model(given.model, terms, _at({("rocker", "x"): 0.001, ("rocker_pin", "z"): 0.002}, terms))
    for one, other in zip(known.model.frames, moved_to.frames, strict=True):
        np.testing.assert_allclose(one.placement.homogeneous, other.placement.homogeneous, atol=1e-15)
    np.testing.assert_allclose(known.model.jointPlacements[3].homogeneous, moved_to.jointPlacements[3].homogeneous)


def test_a_delay_moves_passive_joints_along(rng):
    # Central differences of the poses in time.
    robot, linkage = robot_of("fivebar"), LINKAGES["fivebar"]
    q = 0.3 * rng.uniform(-1, 1, (4, 2))
    problem = problem_at(robot, linkage.frame, q)
    (one,) = problem.sets
    v, step = rng.uniform(-1, 1, (4, 2)), 1e-6
    paths = {0: _Straight(one.t, q, v)}
    late = replace(problem, sets=(replace(one, v=v, moving=True),), paths=paths)
    kinds = nuisances_of(late)
    start = start_of(late)
    column = equations(late, start).nuisance[:, len(kinds) - 1]
    ways = [stepped(kinds, start, (), sign * step * (np.arange(len(kinds)) == len(kinds) - 1)) for sign in (1, -1)]
    up, down = (equations(late, _timed(way)).residual for way in ways)
    np.testing.assert_allclose((down - up) / (2 * step), column, atol=1e-6)


class _Straight:
    """A path that goes straight on from each pose, with derivatives as those of a spline."""

    def __init__(self, t, q, v):
        self._t, self._q, self._v = t, q, v

    def __call__(self, t, derivative=0):
        return self._v if derivative else self._q + (t - self._t)[:, None] * self._v


def _timed(estimate: Estimate) -> Estimate:
    assert estimate.delay[0] != 0.0
    return estimate


@pytest.fixture
def problem(ur10, tracked, slow_motion) -> PoseProblem:
    t, q = slow_motion
    sets, paths = measured_poses(ur10, (tracked(1, q=q, t=t, turned=True, zeros={"elbow_joint": 0.01}),))
    arrays = ("t", "q", "v", "load", "position", "turn")
    sets = tuple(replace(one, **{name: getattr(one, name)[::100] for name in arrays}) for one in sets)
    return PoseProblem(ur10, sets, paths, terms_of(ur10, ["tool0"]))


def test_columns_of_nuisances_are_the_slopes_where_nothing_is_left(problem):
    start = start_of(problem)
    exact = _without_rest(problem, start)
    kinds, step, found = nuisances_of(problem), 1e-6, equations(exact, start)
    for k, kind in enumerate(kinds):
        way = step * (np.arange(len(kinds)) == k)
        up, down = (equations(exact, stepped(kinds, start, (), sign * way)).residual for sign in (1, -1))
        # The velocity of a column is low-passed, that of the path is not.
        close = 1e-2 if kind.kind == DELAY else 1e-6
        np.testing.assert_allclose((down - up) / (2 * step), found.nuisance[:, k], atol=close)


def test_columns_of_terms_are_the_slopes_where_nothing_is_left(problem):
    start = replace(start_of(problem), delay=(0.0,))
    exact = _without_rest(problem, start)
    found, step = equations(exact, start), 1e-6
    assert np.abs(found.residual).max() < 1e-12
    for k in range(len(problem.terms)):
        size = step * (1e-3 if problem.terms[k].parameter == "compliance" else 1.0)
        way = size * (np.arange(len(problem.terms)) == k)
        up, down = (equations(exact, replace(start, values=sign * way)).residual for sign in (1, -1))
        scale = max(1.0, np.abs(found.columns[:, k]).max())
        np.testing.assert_allclose((down - up) / (2 * size), found.columns[:, k], atol=1e-6 * scale)


def _without_rest(problem: PoseProblem, estimate: Estimate) -> PoseProblem:
    """The same with poses that are what is predicted."""
    one = problem.sets[0]
    base, tool = pin.SE3(estimate.base[0]), pin.SE3(estimate.tool[0])
    model, data = problem.robot.model, problem.robot.model.createData()
    poses = []
    for q in one.q:
        pin.framesForwardKinematics(model, data, q)
        poses.append(base * data.oMf[one.index] * tool)
    position = np.array([pose.translation for pose in poses])
    turn = np.array([pin.Quaternion(pose.rotation).coeffs() for pose in poses])
    return replace(problem, sets=(replace(one, position=position, turn=turn),))


@pytest.mark.parametrize("joint", ["shoulder_lift_joint", "elbow_joint", "wrist_3_joint"])
def test_a_changed_model_is_that_of_the_urdf_with_another_origin(ur10, ur10_text, rng, joint):
    terms = tuple(term for term in terms_of(ur10, ["tool0"]) if term.joint == joint and term.effect == LINK)
    values = 0.05 * rng.standard_normal(len(terms))
    model = changed_model(ur10.model, terms, values)
    twist = np.zeros(6)
    for term, value in zip(terms, values, strict=True):
        twist[term.part] = value
    # A twist moves along a screw; its rotation vector and shift as a pose.
    place = pin.exp6(twist)
    q = rng.uniform(-2, 2, 6)
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    text = moved_joint(ur10_text, joint, place.translation, pin.log3(place.rotation))
    there = link_poses(text, dict(zip(ur10.joint_names, q, strict=True)))["tool0"]
    np.testing.assert_allclose(data.oMf[model.getFrameId("tool0")].homogeneous, there, atol=1e-9)


def _parts(terms, joint):
    return [term.parameter for term in terms if term.joint == joint and term.effect == LINK]


def test_a_place_has_no_turn_about_the_joints_own_axis_as_that_is_its_zero(ur10):
    assert _parts(terms_of(ur10, ["tool0"]), "elbow_joint") == ["x", "y", "z", "rx", "rz"]  # it turns about y


def test_a_slide_along_none_of_its_own_axes_keeps_all_six_parts(arm):
    assert len(_parts(terms_of(arm, ["tool"]), "slide")) == 6


def test_joints_behind_the_frame_have_no_terms(ur10):
    joints = {term.joint for term in terms_of(ur10, ["forearm_link"])}
    assert joints == {"shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint"}


def test_an_encoder_on_the_link_sees_the_elasticity_itself(ur10):
    on_link = replace(ur10, actuators=tuple(replace(one, encoder_side="link") for one in ur10.actuators))
    assert not [term for term in terms_of(on_link, ["tool0"]) if term.effect == ELASTIC]


def test_a_compliance_of_a_slide_is_in_metres_by_newton(arm):
    units = {term.unit for term in terms_of(arm, ["tool"]) if term.effect == ELASTIC and term.joint == "slide"}
    assert units == {"m/(N)"}
