# pyright: reportAttributeAccessIssue=false
"""Legs simulated on a base that moves as it was measured. Oracle: Pinocchio's free-flyer, which nobody holds."""

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
import pytest

from floating_leg import written_leg
from phantom_dyn.errors import ParameterError, RobotError
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import BaseMotion
from phantom_dyn.simulation import simulate as simulation
from phantom_dyn.simulation.control import Tracking, torque_over_time
from phantom_dyn.simulation.simulate import Given, simulate

STEP, STEPS, EVERY = 1e-4, 2000, 10


@dataclass(frozen=True)
class Flight:
    """A robot in the air under torques of its joints and pushes on its trunk, as Pinocchio moves it."""

    robot: Robot
    law: Tracking
    q: np.ndarray
    v: np.ndarray
    base: BaseMotion

    def simulated(self) -> np.ndarray:
        found = simulate(self.robot, (), self.law, self.law.t, self.q[0], self.v[0], given=Given(base=self.base))
        return found.links.q


def torque(t: float) -> np.ndarray:
    return np.array([2.0 * np.sin(9.0 * t), 0.15 * np.cos(7.0 * t)])


def push(t: float) -> np.ndarray:
    return np.array([30.0, -20.0, 60.0, 3.0, 4.0, -2.0]) * np.sin(11.0 * t + np.arange(6.0))


@pytest.fixture
def flight(tmp_path) -> Flight:
    """Runge and Kutta's steps of fourth order of Pinocchio's free-flyer, on its Lie group."""
    file = written_leg(tmp_path)
    given = load_robot(file)
    free = pin.buildModelFromUrdf(str(file), pin.JointModelFreeFlyer())
    data = free.createData()

    def gain(t, q, v):
        return np.array(pin.aba(free, data, q, v, np.concatenate([push(t), torque(t)])))

    q, v, rows = pin.neutral(free), np.array([0.3, 0.1, -0.2, 1.0, -0.7, 0.4, 1.5, -2.0]), []
    q[-2:] = 0.4, -0.9
    for k in range(STEPS + 1):
        t, half = k * STEP, 0.5 * STEP
        a = gain(t, q, v)
        if k % EVERY == 0:
            pin.forwardKinematics(free, data, q, v, a)
            felt = pin.getClassicalAcceleration(free, data, 1, pin.LOCAL).linear
            felt = felt - data.oMi[1].rotation.T @ free.gravity.linear
            rows.append((t, q[-2:].copy(), v[-2:].copy(), v[3:6].copy(), a[3:6].copy(), felt))
        v2 = v + half * a
        a2 = gain(t + half, pin.integrate(free, q, half * v), v2)
        v3 = v + half * a2
        a3 = gain(t + half, pin.integrate(free, q, half * v2), v3)
        v4 = v + STEP * a3
        a4 = gain(t + STEP, pin.integrate(free, q, STEP * v3), v4)
        q = pin.integrate(free, q, STEP / 6 * (v + 2 * v2 + 2 * v3 + v4))
        v = v + STEP / 6 * (a + 2 * a2 + 2 * a3 + a4)
    t, at, speed, w, dw, force = (np.array(column) for column in zip(*rows, strict=True))
    robot = replace(given, viscous_friction=np.zeros(2), coulomb_friction=np.zeros(2))
    return Flight(robot, torque_over_time(t, np.array([torque(x) for x in t])), at, speed, BaseMotion(w, dw, force))


def test_legs_move_as_those_of_a_robot_that_flies(flight):
    assert np.ptp(flight.q, axis=0).min() > 0.3
    # Between samples of a millisecond the base is taken to be linear.
    np.testing.assert_allclose(flight.simulated(), flight.q, rtol=0, atol=1e-4)


def test_so_they_do_without_compiled_steps(flight, monkeypatch):
    compiled = flight.simulated()
    monkeypatch.setattr(simulation, "compiled", lambda *given: None)
    np.testing.assert_allclose(flight.simulated(), compiled, rtol=0, atol=1e-11)


@pytest.mark.parametrize("hold", ["zoh", "instant"])
def test_a_controller_in_python_moves_them_as_its_tables_do(flight, hold):
    robot = replace(flight.robot, torque_hold=hold)
    given = Given(base=flight.base)
    moved = [
        simulate(robot, (), law, flight.law.t, flight.q[0], flight.v[0], given=given).links.q
        for law in (flight.law, lambda t, q, v: flight.law(t, q, v))
    ]
    np.testing.assert_allclose(moved[0], moved[1], rtol=0, atol=1e-11)


def test_a_leg_of_one_joint_is_moved_by_its_base(flight):
    # Closed form: a pendulum in a lift that accelerates upwards with g swings sqrt(2) times as fast.
    robot = flight.robot
    model = pin.buildReducedModel(robot.model, [2], np.array([0.0, 0.0]))
    one = replace(
        robot,
        model=model,
        actuators=robot.actuators[:1],
        viscous_friction=np.zeros(1),
        coulomb_friction=np.zeros(1),
    )
    t, none = np.linspace(0.0, 1.0, 101), np.zeros((101, 3))
    base = BaseMotion(none, none, np.tile([0.0, 0.0, 2 * 9.81], (101, 1)))
    law = torque_over_time(t, np.zeros((101, 1)))
    inertia = float(pin.crba(model, model.createData(), np.zeros(1))[0, 0])
    arm = model.inertias[1]
    rest = float(np.arctan2(arm.lever[0], -arm.lever[2]))
    w = np.sqrt(2 * 9.81 * arm.mass * np.hypot(arm.lever[0], arm.lever[2]) / inertia)
    found = simulate(one, (), law, t, np.array([rest + 1e-3]), given=Given(base=base)).links.q[:, 0]
    np.testing.assert_allclose(found - rest, 1e-3 * np.cos(w * t), rtol=0, atol=2e-6)


def test_a_base_of_another_length_is_refused(flight):
    with pytest.raises(ParameterError, match=r"The motion of the base has 3 samples, wanted 201, one a time"):
        replace(flight, base=flight.base.at(slice(3))).simulated()


def test_a_base_that_nobody_knows_is_refused(flight):
    with pytest.raises(RobotError, match=r"leg is not bolted down \(base: floating\): give the motion of its base"):
        simulate(flight.robot, (), flight.law, flight.law.t, flight.q[0])
