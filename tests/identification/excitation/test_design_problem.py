"""Exciting motions as a problem of optimisation: criteria, limits, costs."""

import numpy as np
import pytest

from identification.excitation.collisions import collisions_of
from identification.excitation.criteria import ConditionNumber, DOptimality, condition_number
from identification.excitation.descent import Penalty
from identification.excitation.design_problem import DesignProblem, Grid, base_of, earlier_factor
from identification.excitation.limits import FrameBox, limits_of
from identification.excitation.motion_shapes import BSplines, FourierSeries, TrianglesAndSines
from phantom_dyn.dynamics.dynamics import inverse_dynamics, modelled_friction, rigid_body_regressor, standard_parameters
from phantom_dyn.errors import ParameterError
from phantom_dyn.model.loading import load_robot
from phantom_dyn.motion import Motion

CRITERIA = [ConditionNumber(), ConditionNumber(20.0, 0.0), DOptimality(), DOptimality(0.1)]


@pytest.fixture
def W(rng) -> np.ndarray:
    return rng.normal(size=(40, 6)) * np.geomspace(0.1, 10.0, 6)


@pytest.mark.parametrize("criterion", CRITERIA, ids=repr)
def test_the_slope_is_that_of_differences(criterion, W, rng):
    # Oracle: central differences in a symmetric direction.
    G, way, h = W.T @ W, rng.normal(size=(6, 6)), 1e-6
    way = way + way.T
    _, slope = criterion.cost(G)
    expected = (criterion.cost(G + h * way)[0] - criterion.cost(G - h * way)[0]) / (2 * h)
    assert (slope * way).sum() == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("criterion", CRITERIA, ids=repr)
def test_what_is_not_excited_has_a_finite_cost_and_slope(criterion, W):
    W[:, 2] = W[:, 1]
    cost, slope = criterion.cost(W.T @ W)
    assert np.isfinite(cost)
    assert np.isfinite(slope).all()


def test_the_condition_number_is_that_of_columns_of_one_norm(W):
    # Oracle: numpy.linalg.cond.
    assert condition_number(W.T @ W) == pytest.approx(np.linalg.cond(W / np.linalg.norm(W, axis=0)), rel=1e-9)


def test_a_sharp_cost_is_the_logarithm_of_the_condition_number(W):
    G = W.T @ W
    assert ConditionNumber(200.0, 0.0).cost(G)[0] == pytest.approx(np.log(condition_number(G)), abs=0.01)


def test_the_cost_is_never_below_the_logarithm_of_the_condition_number(W):
    G = W.T @ W
    assert ConditionNumber(2.0, 0.0).cost(G)[0] >= np.log(condition_number(G))


def test_the_size_of_a_column_does_not_change_the_condition_number(W):
    scaled = W * np.geomspace(1e-3, 1e3, 6)
    first, second = (ConditionNumber(6.0, 0.0).cost(m.T @ m)[0] for m in (W, scaled))
    assert first == pytest.approx(second, rel=1e-9)


def test_d_optimality_is_the_mean_logarithm_of_the_standard_deviations():
    # Closed form: independent parameters with the deviations 1/2 and 1/10.
    cost, _ = DOptimality(1e-12).cost(np.diag([4.0, 100.0]))
    assert cost == pytest.approx((np.log(0.5) + np.log(0.1)) / 2)


def test_a_column_that_is_zero_has_an_infinite_condition_number():
    assert condition_number(np.diag([1.0, 0.0])) == np.inf


def test_columns_that_are_the_same_have_an_infinite_condition_number():
    assert condition_number(np.ones((2, 2))) == np.inf


def test_no_column_has_no_condition_number():
    assert np.isnan(condition_number(np.zeros((0, 0))))


@pytest.mark.parametrize("make", [lambda: DOptimality(0.0), lambda: ConditionNumber(np.nan)])
def test_what_is_not_above_zero_is_refused(make):
    with pytest.raises(ParameterError, match=r"is \S+: give a number above 0\."):
        make()


def test_a_negative_weight_of_information_is_refused():
    with pytest.raises(ParameterError, match=r"The weight of information is -1\.0: give a number of 0 or more"):
        ConditionNumber(information=-1.0)


FAMILIES = [FourierSeries(3.0, 3), BSplines(3.0, 4), TrianglesAndSines(3.0, 2, 2)]


def slope_and_difference(problem: DesignProblem, shapes, rng: np.random.Generator) -> tuple[float, float]:
    """Slope of cost and penalty along a random way, and the central difference; every limit is exceeded somewhere."""
    grid = Grid.of(shapes, 40)
    weights = rng.normal(size=(grid.values.shape[2], problem.robot.nv))
    multipliers = rng.uniform(0, 1, (2, 40, len(problem.bounds.labels)))
    penalty = Penalty(
        problem.bounds, 3.0, multipliers * np.isfinite([problem.bounds.lower, problem.bounds.upper])[:, None]
    )
    way, h = rng.normal(size=weights.shape), 1e-6
    slope = (problem.cost(grid, weights, penalty)[1] * way).sum()
    sides = [problem.cost(grid, weights + step * way, penalty)[0] for step in (h, -h)]
    return slope, (sides[0] - sides[1]) / (2 * h)


@pytest.mark.parametrize("criterion", [ConditionNumber(), DOptimality()], ids=repr)
@pytest.mark.parametrize("shapes", FAMILIES, ids=repr)
def test_the_slope_of_cost_and_limits_is_that_of_differences(spatial, shapes, criterion, rng):
    # Oracle: central differences; a linear joint, a skew axis, limits of acceleration and of the tip's place.
    box = FrameBox(spatial.model.frames[-1].name, np.full(3, -0.1), np.array([0.1, np.inf, 0.2]))
    problem = DesignProblem(spatial, base_of(spatial), criterion, limits_of(spatial, acceleration=1.0, boxes=[box]))
    slope, difference = slope_and_difference(problem, shapes, rng)
    assert slope == pytest.approx(difference, rel=1e-6)


def test_the_slope_holds_in_a_chain_with_friction_and_earlier_recordings(rng):
    robot = load_robot("phantom_1_5")
    earlier = earlier_factor(robot, [Motion(np.arange(4.0), *rng.normal(size=(3, 4, 3)))])
    base = base_of(robot, planned=10.0, noise=[1.0, 2.0, 0.5], earlier=earlier)
    problem = DesignProblem(robot, base, ConditionNumber(), limits_of(robot, velocity=1.0))
    slope, difference = slope_and_difference(problem, FourierSeries(3.0, 3), rng)
    # The regressor of a closed chain is good to about 1e-9, which a difference of 1e-6 magnifies.
    assert slope == pytest.approx(difference, rel=1e-5)


def test_the_slope_holds_where_bodies_come_close(chain_of_balls, rng):
    collisions = collisions_of(chain_of_balls, clearance=1.5)
    problem = DesignProblem(
        chain_of_balls, base_of(chain_of_balls), DOptimality(), limits_of(chain_of_balls, collisions=collisions)
    )
    slope, difference = slope_and_difference(problem, FourierSeries(3.0, 3), rng)
    assert slope == pytest.approx(difference, rel=1e-4)


def test_the_limited_torque_is_that_of_inverse_dynamics_without_coulomb_friction(planar, rng):
    # Oracle: phantom_dyn.dynamics.dynamics.
    problem = DesignProblem(planar, base_of(planar), ConditionNumber(), limits_of(planar))
    motion = Motion(np.arange(6.0), *rng.normal(size=(3, 6, 2)))
    values = problem.limited(motion, problem.regressor(motion))
    coulomb = np.sign(motion.v) * planar.coulomb_friction
    np.testing.assert_allclose(values[:, 6:], inverse_dynamics(planar, motion) - coulomb, atol=1e-10)


def test_the_limited_torque_of_a_chain_holds_that_of_its_passive_joints(rng):
    # Oracle: phantom_dyn.dynamics.dynamics.
    robot = load_robot("phantom_1_5")
    problem = DesignProblem(robot, base_of(robot), ConditionNumber(), limits_of(robot))
    motion = Motion(np.arange(6.0), *rng.uniform(-0.5, 0.5, (3, 6, 3)))
    values = problem.limited(motion, problem.regressor(motion))
    difference = inverse_dynamics(robot, motion) - values[:, 5 + 5 + 3 :]
    coulomb = np.abs(modelled_friction(robot, motion)).max() + 1e-9
    assert np.abs(difference).max() <= coulomb


def test_base_columns_give_the_torque_of_all(planar, rng):
    # Known truth: the base parameters of planar arms are six with gravity (two hinges: Izz, mx, mz each, regrouped).
    base = base_of(planar)
    W = rigid_body_regressor(planar, Motion(np.arange(50.0), *rng.normal(size=(3, 50, 2))))
    rows = W.reshape(-1, W.shape[2])
    kept = rows[:, list(base.columns)]
    torque = rows @ standard_parameters(planar)
    assert len(base.columns) == 6
    np.testing.assert_allclose(kept @ np.linalg.lstsq(kept, torque)[0], torque, atol=1e-10)


def test_information_adds_up_over_recordings(planar, rng):
    first, second = (Motion(np.arange(20.0), *rng.normal(size=(3, 20, 2))) for _ in range(2))
    base = base_of(planar, planned=20.0, earlier=earlier_factor(planar, [first]))
    problem = DesignProblem(planar, base, ConditionNumber(), limits_of(planar))
    both = Motion(np.arange(40.0), *(np.concatenate([getattr(first, x), getattr(second, x)]) for x in "qva"))
    alone = DesignProblem(planar, base_of(planar), ConditionNumber(), limits_of(planar))
    added = problem.information(problem.regressor(second))
    np.testing.assert_allclose(added, 2 * alone.information(alone.regressor(both)), rtol=1e-9, atol=1e-12)


def test_a_factor_of_another_robot_is_refused(planar, spatial):
    factor = earlier_factor(spatial, [Motion(np.arange(4.0), *np.ones((3, 4, 3)))])
    with pytest.raises(ParameterError, match="make it with earlier_factor for this robot"):
        base_of(planar, earlier=factor)


@pytest.mark.parametrize("noise", [0.0, -1.0, np.nan, [1.0, 2.0, 3.0]])
def test_a_noise_that_is_none_is_refused(planar, noise):
    with pytest.raises(ParameterError, match="was given for 2 joints: give a number above 0, or one for each joint"):
        base_of(planar, noise=noise)
