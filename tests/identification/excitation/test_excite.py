from dataclasses import replace

import numpy as np
import pytest

from identification.excitation.collisions import collisions_of, distances
from identification.excitation.criteria import DOptimality
from identification.excitation.design_problem import earlier_factor
from identification.excitation.excite import Excitation, PlannedRecording, excite
from identification.excitation.limits import FrameBox, limits_of
from identification.excitation.motion_shapes import BSplines, FourierSeries, TrianglesAndSines
from identification.regression.base_parameters import base_parameters_of_matrix
from phantom_dyn import load_robot
from phantom_dyn.dynamics.dynamics import inverse_dynamics, rigid_body_regressor
from phantom_dyn.errors import ParameterError
from phantom_dyn.model.inertia import parameter_names, parameter_units
from phantom_dyn.model.robot import Actuator

SHAPES = FourierSeries(4.0, 3)
FAST = {"starts": 4}


@pytest.fixture(scope="module")
def designed(planar) -> Excitation:
    return excite(planar, SHAPES, limits=limits_of(planar, velocity=3.0, acceleration=20.0), **FAST)


def test_the_motion_begins_and_ends_at_rest(designed):
    motion = designed.motion(100.0)
    np.testing.assert_allclose(motion.v[[0, -1]], 0.0, atol=1e-9)
    np.testing.assert_allclose(motion.a[[0, -1]], 0.0, atol=1e-9)


def test_the_motion_keeps_every_limit_at_any_rate(designed, planar):
    # Oracle: inverse dynamics with friction, at a rate that the design has not seen.
    motion = designed.motion(1733.0)
    assert (np.abs(motion.q) <= 3).all()
    assert (np.abs(motion.v) <= 3).all()
    assert (np.abs(motion.a) <= 20).all()
    assert (np.abs(inverse_dynamics(planar, motion)) <= [40, 20]).all()


def test_the_condition_number_is_that_of_the_base_parameters(designed, planar):
    # Oracle: the base parameters of the same motion, by their own decomposition.
    W = rigid_body_regressor(planar, designed.motion(1000.0))
    base = base_parameters_of_matrix(W.reshape(-1, W.shape[2]), parameter_names(planar), parameter_units(planar))
    assert designed.rank == base.rank
    assert designed.condition == pytest.approx(base.condition, rel=0.02)


def test_the_motion_is_better_than_the_random_one_that_it_is_made_from(designed):
    assert designed.condition < 0.8 * designed.start


@pytest.mark.whole
def test_the_same_seed_gives_the_same_motion(designed, planar):
    again = excite(planar, SHAPES, limits=limits_of(planar, velocity=3.0, acceleration=20.0), **FAST)
    np.testing.assert_array_equal(again.weights, designed.weights)


def test_times_end_on_the_last_step(designed):
    t = designed.motion(99.7).t
    assert t[-1] == 4.0
    np.testing.assert_allclose(np.diff(t), t[1])


@pytest.mark.parametrize("shapes", [BSplines(4.0, 6), TrianglesAndSines(4.0, 2, 3)], ids=repr)
def test_other_families_keep_the_limits_too(planar, shapes):
    motion = excite(planar, shapes, limits=limits_of(planar, velocity=2.0), **FAST).motion(500.0)
    assert (np.abs(motion.q) <= 3).all()
    assert (np.abs(motion.v) <= 2).all()
    np.testing.assert_allclose(motion.v[[0, -1]], 0.0, atol=1e-9)


@pytest.mark.whole
def test_information_grows_with_d_optimality(designed, planar):
    # Known truth: the mean logarithm of standard deviations is what it minimises.
    limits = limits_of(planar, velocity=3.0, acceleration=20.0)
    sentence = excite(planar, SHAPES, limits=limits, criterion=DOptimality(), **FAST)
    columns = [names.index(x) for names in [parameter_names(planar)] for x in ("upper.mx", "upper.mz", "upper.Iyy")]

    def volume(design: Excitation) -> float:
        W = rigid_body_regressor(planar, design.motion(200.0))[:, :, columns].reshape(-1, 3)
        return float(np.linalg.slogdet(W.T @ W)[1])

    assert volume(sentence) > volume(designed)


@pytest.mark.whole
def test_a_frame_stays_in_its_box(planar):
    box = FrameBox("lower", np.array([-0.2, -np.inf, -np.inf]), np.array([0.2, np.inf, -0.3]))
    motion = excite(planar, SHAPES, limits=limits_of(planar, velocity=3.0, boxes=[box]), **FAST).motion(500.0)
    # Closed form: the lower link begins at the end of the upper one, 0.5 m from the shoulder.
    assert (np.abs(0.5 * np.sin(motion.q[:, 0])) <= 0.2).all()
    assert (-0.5 * np.cos(motion.q[:, 0]) <= -0.3).all()


@pytest.mark.whole
def test_bodies_keep_their_clearance(chain_of_balls):
    collisions = collisions_of(chain_of_balls, clearance=0.3)
    limits = limits_of(chain_of_balls, collisions=collisions)
    motion = excite(chain_of_balls, FourierSeries(4.0, 2), limits=limits, **FAST).motion(250.0)
    apart, _ = distances(chain_of_balls.model, collisions, np.array(motion.q), slopes=False)
    assert apart.min() >= 0.3


@pytest.mark.parametrize("name", ["pendulum.urdf", "arm3.xml"])
def test_one_joint_and_linear_joints_without_limits_work(name, robots):
    robot = load_robot(robots / name)
    design = excite(robot, SHAPES, limits=limits_of(robot, velocity=1.0), **FAST)
    motion = design.motion(500.0)
    assert (np.abs(motion.v) <= 1.0).all()
    assert np.isfinite(design.condition)


@pytest.mark.whole
def test_a_continuous_joint_works(tmp_path, chain_of_balls):
    path = tmp_path / "turning.urdf"
    text = (tmp_path / "balls.urdf").read_text()
    path.write_text(text.replace('type="revolute"', 'type="continuous"'))
    robot = load_robot(path)
    assert robot.nq == 2 * robot.nv
    motion = excite(robot, FourierSeries(4.0, 2), **FAST).motion(500.0)
    assert (np.abs(motion.v) <= 2.0).all()
    assert (np.abs(inverse_dynamics(robot, motion)) <= 60.0).all()


@pytest.mark.whole
def test_a_chain_keeps_the_limits_of_its_passive_joints():
    robot = load_robot("phantom_1_5")
    motion = excite(robot, SHAPES, limits=limits_of(robot, velocity=3.0), **FAST).motion(500.0)
    assert robot.chain is not None
    tree = motion.q @ robot.chain.linear_map.T + robot.chain.offset
    assert (tree <= robot.model.upperPositionLimit + 1e-12).all()
    assert (tree >= robot.model.lowerPositionLimit - 1e-12).all()


@pytest.mark.whole
def test_earlier_recordings_are_complemented(planar, designed):
    # Known truth: a recording of the shoulder alone leaves the elbow to be excited; both together are better than the
    # new motion by itself would be if it had been made without knowing.
    still = designed.motion(100.0)
    alone = replace(still, q=still.q * [1, 0], v=still.v * [1, 0], a=still.a * [1, 0])
    factor = 10 * earlier_factor(planar, [alone])
    limits = limits_of(planar, velocity=3.0, acceleration=20.0)
    knowing = excite(planar, SHAPES, limits=limits, planned=PlannedRecording(earlier=factor), **FAST)

    def condition(design: Excitation) -> float:
        both = np.vstack([factor, earlier_factor(planar, [design.motion(100.0)])])
        units = parameter_units(planar)
        return base_parameters_of_matrix(both, parameter_names(planar), units).condition

    assert condition(knowing) < condition(designed)
    assert knowing.condition == pytest.approx(condition(knowing), rel=0.05)


@pytest.mark.whole
def test_a_posture_that_no_drive_can_hold_is_refused_with_the_limit(planar):
    # Known truth: with the elbow free, the least torque anywhere is zero, hanging; a box keeps the arm out of there.
    weak = replace(planar, actuators=(Actuator(torque_limit=3.0), Actuator(torque_limit=3.0)))
    box = FrameBox("lower", np.array([0.4, -np.inf, -np.inf]), np.full(3, np.inf))
    with pytest.raises(ParameterError, match=r"No posture .* planar2 can rest: .* reaches .* of .*; widen that limit"):
        excite(weak, SHAPES, limits=limits_of(weak, boxes=[box]), **FAST)


def test_a_box_out_of_reach_is_refused_with_the_distance(planar):
    # Closed form: the frame reaches 0.5 m, 1.5 m short of the box.
    box = FrameBox("lower", np.array([2.0, -np.inf, -np.inf]), np.full(3, np.inf))
    with pytest.raises(ParameterError, match=r"the x of frame lower reaches 0\.5 m, 1\.5 m under its limit of 2 m"):
        excite(planar, SHAPES, limits=limits_of(planar, boxes=[box]), **FAST)


@pytest.mark.parametrize("rate", [0.0, np.nan, -5.0])
def test_a_rate_that_is_none_is_refused(planar, rate):
    with pytest.raises(ParameterError, match=r"The sample rate is \S+: give a number above 0"):
        excite(planar, SHAPES, planned=PlannedRecording(rate))


def test_a_rate_that_cannot_show_the_motion_is_refused(designed):
    with pytest.raises(ParameterError, match=r"A rate of 2 Hz is too low to show this motion: give at least 7\.5 Hz"):
        designed.motion(2.0)


def test_more_rows_than_anyone_can_want_are_refused(planar):
    with pytest.raises(ParameterError, match=r"4 s at 1e\+09 Hz are more than 5000000 rows: give a lower rate"):
        excite(planar, SHAPES, planned=PlannedRecording(1e9))


@pytest.mark.whole
def test_a_tiny_limit_of_acceleration_is_kept(planar):
    motion = excite(planar, SHAPES, limits=limits_of(planar, acceleration=1e-4), starts=1).motion(500.0)
    assert 0 < np.abs(motion.a).max() <= 1e-4


def test_limits_between_which_nothing_moves_are_refused_with_the_one_that_is_broken(planar):
    # Known truth: a hanging arm rests without torque, and each motion needs more than a hundred-millionth of a newton
    # metre.
    drives = (Actuator(torque_limit=1e-8), Actuator(torque_limit=1e-8))
    weak = replace(planar, actuators=drives, coulomb_friction=np.zeros(2))
    with pytest.raises(ParameterError, match=r"no motion about that posture keeps them: .* torque of .* its limit"):
        excite(weak, SHAPES, limits=limits_of(weak, velocity=1.0), starts=1)


def test_no_start_is_refused(planar):
    with pytest.raises(ParameterError, match="0 starts were asked for: give at least one"):
        excite(planar, SHAPES, starts=0)


def test_the_summary_names_the_limits_that_are_reached(designed):
    said = designed.summary()
    assert said.startswith("planar2: condition number ")
    assert "columns of norm one" in said
    assert all(label in said for label in designed.reached)
