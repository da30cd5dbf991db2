"""Exciting motions of chains whose loops are closed numerically: a four-bar and a five-bar."""

from dataclasses import replace

import numpy as np
import pytest

from identification.excitation.closable import CLEAR, closable, ordinary_postures
from identification.excitation.criteria import ConditionNumber, DOptimality
from identification.excitation.descent import Penalty
from identification.excitation.design_problem import DesignProblem, Grid, base_of
from identification.excitation.excite import Excitation, excite
from identification.excitation.limits import FrameBox, bounds_of, limits_of
from identification.excitation.motion_shapes import FourierSeries
from identification.regression.base_parameters import base_parameters_of_matrix
from phantom_dyn import load_robot
from phantom_dyn.dynamics.dynamics import inverse_dynamics, rigid_body_regressor
from phantom_dyn.dynamics.tree_motion import tree_motion
from phantom_dyn.errors import ParameterError
from phantom_dyn.loops.solver import distance_from_singularity
from phantom_dyn.model.inertia import parameter_names, parameter_units
from phantom_dyn.model.robot import Actuator, Robot
from phantom_dyn.motion import Motion
from places import ROBOTS

SHAPES = FourierSeries(4.0, 3)


def rubbing(name: str) -> Robot:
    """The linkage with rotors and friction on all joints."""
    robot = load_robot(ROBOTS / name)
    model, chain = robot.model.copy(), robot.chain
    assert chain is not None
    model.armature = np.linspace(1e-3, 4e-3, model.nv)
    passive = np.full(len(chain.passive), 0.02)
    chain = replace(chain, viscous_friction=passive, coulomb_friction=passive)
    drives = tuple(Actuator(torque_limit=3.0) for _ in robot.actuators)
    return replace(robot, model=model, chain=chain, actuators=drives, viscous_friction=np.full(robot.nv, 0.05))


@pytest.fixture(scope="module")
def five_bar() -> Robot:
    """A five-bar whose left elbow may bend by 0.8 rad."""
    robot = rubbing("fivebar.xml")
    model = robot.model.copy()
    row = model.joints[model.getJointId("left_elbow")].idx_q
    lower, upper = np.array(model.lowerPositionLimit), np.array(model.upperPositionLimit)
    lower[row], upper[row] = -0.8, 0.8
    model.lowerPositionLimit, model.upperPositionLimit = lower, upper
    return replace(robot, model=model)


@pytest.fixture(scope="module")
def designed(five_bar) -> Excitation:
    return excite(five_bar, SHAPES, limits=limits_of(five_bar, velocity=5.0, acceleration=60.0), starts=2)


# The condition number of the four-bar's eight parameters is rounding in motions that every limit is exceeded by.
@pytest.mark.parametrize(
    ("name", "criterion"),
    [("fivebar.xml", ConditionNumber()), ("fivebar.xml", DOptimality()), ("fourbar.xml", DOptimality())],
)
def test_the_slope_of_cost_and_limits_is_that_of_differences(name, criterion, rng):
    # Oracle: central differences, with friction and rotors on passive joints, a box, and every limit exceeded.
    robot = rubbing(name)
    box = FrameBox(robot.model.frames[-1].name, np.full(3, -0.01), np.full(3, 0.01))
    limits = limits_of(robot, velocity=0.5, acceleration=1.0, boxes=[box], clear=0.9)
    problem = DesignProblem(robot, base_of(robot), criterion, replace(limits, torque=np.full(robot.nv, 0.2)))
    grid = Grid.of(SHAPES, 30)
    # Of smaller motions some parameters hardly show, and the criterion is rounding.
    weights = {"fourbar.xml": 0.3, "fivebar.xml": 0.1}[name] * rng.normal(size=(grid.values.shape[2], robot.nv))
    multipliers = rng.uniform(0, 1, (2, 30, len(problem.bounds.labels)))
    known = np.isfinite([problem.bounds.lower, problem.bounds.upper])[:, None]
    penalty = Penalty(problem.bounds, 3.0, multipliers * known)
    way, h = rng.normal(size=weights.shape), 1e-4
    slope = (problem.cost(grid, weights, penalty)[1] * way).sum()
    sides = [problem.cost(grid, weights + step * way, penalty)[0] for step in (h, -h)]
    assert slope == pytest.approx((sides[0] - sides[1]) / (2 * h), rel=1e-4)


def test_the_limited_torque_is_that_of_inverse_dynamics_without_coulomb_friction(five_bar, rng):
    # Oracle: phantom_dyn.dynamics.dynamics.
    robot, chain = five_bar, five_bar.chain
    smooth = replace(robot, chain=replace(chain, coulomb_friction=0 * chain.coulomb_friction))
    problem = DesignProblem(robot, base_of(robot), ConditionNumber(), limits_of(robot))
    motion = Motion(np.arange(6.0), *rng.uniform(-0.5, 0.5, (3, 6, 2)))
    values = problem.limited(motion, problem.regressor(motion))
    rows = [problem.bounds.labels.index(f"torque of {joint}") for joint in robot.joint_names]
    np.testing.assert_allclose(values[:, rows], inverse_dynamics(smooth, motion), atol=1e-10)


def test_the_motion_keeps_all_limits_those_of_passive_joints_and_the_singularity_too(designed, five_bar):
    # Oracle: the loops solved at a rate that the design has not seen, inverse dynamics with friction.
    motion = designed.motion(733.0)
    tree = tree_motion(five_bar, motion)
    elbow = five_bar.model.getJointId("left_elbow") - 1
    assert (np.abs(tree.q[:, elbow]) <= 0.8).all()
    assert (np.abs(motion.v) <= 5).all()
    assert (np.abs(motion.a) <= 60).all()
    assert (np.abs(inverse_dynamics(five_bar, motion)) <= 3.0).all()
    assert distance_from_singularity(five_bar.solutions.at(motion.q).inverse).min() >= CLEAR
    np.testing.assert_allclose(motion.v[[0, -1]], 0.0, atol=1e-9)


def test_without_that_limit_the_passive_joint_would_go_further(designed, five_bar):
    tree = tree_motion(five_bar, designed.motion(200.0))
    assert np.abs(tree.q[:, five_bar.model.getJointId("left_elbow") - 1]).max() > 0.5
    assert np.abs(tree.q[:, five_bar.model.getJointId("right_elbow") - 1]).max() > 0.8


def test_the_condition_number_is_that_of_the_base_parameters(designed, five_bar):
    # Oracle: the base parameters of the same motion, by their own decomposition.
    W = rigid_body_regressor(five_bar, designed.motion(500.0))
    names, units = parameter_names(five_bar), parameter_units(five_bar)
    base = base_parameters_of_matrix(W.reshape(-1, W.shape[2]), names, units)
    assert designed.rank == base.rank
    assert designed.condition == pytest.approx(base.condition, rel=0.02)
    assert designed.condition < 0.8 * designed.start


@pytest.mark.whole
def test_a_four_bar_is_excited_too():
    # Known truth: one drive feels the eight base parameters of three links in a plane.
    robot = load_robot(ROBOTS / "fourbar.xml")
    design = excite(robot, SHAPES, limits=limits_of(robot, velocity=6.0, acceleration=60.0), starts=2)
    assert design.rank == 8
    assert design.condition < design.start
    # The design checks a grid of samples, between which the distance dips a little.
    least = distance_from_singularity(robot.solutions.at(design.motion(300.0).q).inverse).min()
    assert least >= CLEAR - 0.001


def test_friction_of_passive_joints_is_taken_off_the_torque():
    # By hand: no posture turns the passive joints faster than the one in which they turn fastest.
    robot = rubbing("fivebar.xml")
    bounds, rows = bounds_of(robot, limits_of(robot)), list(robot.chain.passive)
    taken = 3.0 - bounds.upper[bounds.labels.index("torque of left")]
    each = [0.02 * np.abs(robot.solutions.at(q[None]).G[0, rows, 0]).sum() for q in ordinary_postures(robot)]
    assert max(each) <= taken < 3 * max(each)


def test_postures_out_of_reach_are_distinguished_from_those_in_reach():
    # Closed form: with both arms pointing outwards the elbows are 0.54 m apart, with 0.6 m of forearms between them.
    robot = load_robot(ROBOTS / "fivebar.xml")
    q = np.array([[0.3, -0.2], [-np.pi / 2, np.pi / 2], [np.pi / 2, -np.pi / 2]])
    np.testing.assert_array_equal(closable(robot, q), [True, True, True])
    far = load_far(robot)
    np.testing.assert_array_equal(closable(far, q), [True, False, True])


def load_far(robot: Robot) -> Robot:
    """The five-bar with bearings 0.2 m further apart: then they would be 0.74 m apart."""
    model = robot.model.copy()
    place = model.jointPlacements[model.getJointId("right")]
    place.translation = place.translation + np.array([0.2, 0.0, 0.0])
    return replace(robot, model=model)


@pytest.mark.parametrize("clear", [0.0, 1.0, -0.1, np.nan])
def test_a_distance_that_is_none_is_refused(clear):
    with pytest.raises(ParameterError, match=r"from a singularity was given: give one from 0 to 1"):
        limits_of(load_robot(ROBOTS / "fivebar.xml"), clear=clear)
