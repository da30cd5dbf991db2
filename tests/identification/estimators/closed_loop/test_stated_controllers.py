"""A torque that the stated controllers did not give; known truth: the gains that moved the robot."""

from dataclasses import replace

import numpy as np
import pytest

from identification.data.log import Band, Log
from identification.estimators.closed_loop.didim import didim
from identification.regression.regressor import Regressor, gap_regressor
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.errors import LogError
from phantom_dyn.model.robot import Controller, Robot
from phantom_dyn.motion import Motion
from phantom_dyn.simulation.control import position_control
from phantom_dyn.simulation.simulate import simulate


@pytest.fixture(scope="module")
def moved(pendulum) -> Log:
    """By a controller of kp 60 and kd 8."""
    t = np.arange(800) * 5e-3
    q_ref = 0.5 * (np.sin(2.1 * t) + 0.4 * np.sin(5.3 * t) + 0.2 * np.sin(11.0 * t))[:, None]
    law = position_control(t, q_ref, np.zeros_like(q_ref), kp=np.array([60.0]), kd=np.array([8.0]))
    out = simulate(pendulum, (), law, t, q_ref[0])
    motion = Motion(t, out.q, out.encoders.v, out.encoders.a)
    band = Band(200.0, 100.0, np.ones(1), 1)
    return Log("made", pendulum.joint_names, motion, out.tau, band, np.ones(len(t), bool), out.q, q_ref)


def equations(robot: Robot, log: Log, kp: float, kd: float) -> Regressor:
    stated = replace(robot, actuators=(replace(robot.actuators[0], controller=Controller("pd", kp, kd)),))
    return gap_regressor(stated, (log,), [(effect_named("viscous_friction"), "pin")])


def test_gains_that_did_not_move_the_robot_are_refused_with_those_that_did(pendulum, moved):
    with pytest.raises(LogError, match=r"made: the stated controller of pin \(kp 20, kd 2\) .*kp = 60 and kd = 8 woul"):
        didim(equations(pendulum, moved, 20.0, 2.0))


def test_a_torque_that_no_gains_give_is_refused_without_gains(pendulum, moved, rng):
    noise = replace(moved, tau=rng.standard_normal(moved.tau.shape))
    with pytest.raises(LogError, match=r"% of it apart: state the controller that moved the robot, or use an estim"):
        didim(equations(pendulum, noise, 60.0, 8.0))


def test_gains_that_are_a_tenth_off_are_fitted(pendulum, moved):
    assert abs(didim(equations(pendulum, moved, 66.0, 8.8)).theta[0]) < 2.0
