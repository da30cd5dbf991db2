"""Torque that errors of the base's sensors feign. Oracle: the log read once more with sensors that have the error."""

from dataclasses import replace

import numpy as np
import pytest

from floating_leg import written_leg
from identification.data.floating.base_errors import SENSOR_ERRORS, torque_of_base_errors, torque_per_base_error
from identification.data.log import Band, BaseSensors, Log
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.dynamics.moving_base import base_motion
from phantom_dyn.model.loading import load_robot
from phantom_dyn.motion import Motion

RATE, SMALL = 1000.0, 1e-5
T = np.arange(400) / RATE


@pytest.fixture
def robot(tmp_path):
    return load_robot(written_leg(tmp_path))


def waves(late=0.0, order=0):
    """Three sines of which all derivatives are known, at times that are later."""
    w, phase = 2 * np.pi * np.array([2.0, 3.0, 5.0]), np.array([0.1, 1.3, 2.2])
    return w**order * np.sin(w * (T[:, None] + late) + phase + order * np.pi / 2)


def joints():
    return (waves()[:, :2], waves(order=1)[:, :2], waves(order=2)[:, :2])


def read(robot, w, dw, sf):
    """A log in which the sensors at the link imu read that; they are turned there and off the root."""
    motion = Motion(T, *joints(), base=base_motion(robot, "imu", "imu", w, dw, sf))
    band = Band(RATE, 20.0, np.array([1.0]), 1)
    tau = np.zeros((len(T), 2))
    valid = np.ones(len(T), dtype=bool)
    sensors = BaseSensors("imu", "imu", (0.0, 0.0))
    return Log("log", robot.joint_names, motion, tau, band, valid, base_sensors=sensors)


def plain():
    return waves(), waves(order=1), 9.0 + 3.0 * waves(late=0.05)


def torque_more(robot, w, dw, sf):
    """By the reading without the error, per unit of the error."""
    given, mended = (inverse_dynamics(robot, read(robot, *x).motion) for x in (plain(), (w, dw, sf)))
    return (mended - given) / SMALL


def one(axis):
    return SMALL * np.eye(3)["xyz".index(axis)]


def found(robot, name):
    log = read(robot, *plain())
    return torque_per_base_error(robot, log, log.motion)[name]


def alike(x, y):
    return np.abs(x - y).max() <= 2e-4 * max(1.0, np.abs(y).max())


@pytest.mark.parametrize("axis", "xyz")
def test_an_offset_is_added_to_a_reading(robot, axis):
    w, dw, sf = plain()
    assert alike(found(robot, f"gyroscope offset {axis}"), torque_more(robot, w + one(axis), dw, sf))
    assert alike(found(robot, f"accelerometer offset {axis}"), torque_more(robot, w, dw, sf + one(axis)))


@pytest.mark.parametrize("axis", "xyz")
def test_a_scale_is_of_one_axis_of_a_sensor(robot, axis):
    w, dw, sf = plain()
    scale = 1 + one(axis)
    assert alike(found(robot, f"gyroscope scale {axis}"), torque_more(robot, scale * w, scale * dw, sf))
    assert alike(found(robot, f"accelerometer scale {axis}"), torque_more(robot, w, dw, scale * sf))


@pytest.mark.parametrize("axis", "xyz")
def test_a_turn_is_of_both_sensors_about_an_axis_of_the_root(robot, axis):
    placed = robot.model.frames[robot.model.getFrameId("imu")].placement.rotation
    turned = [x + np.cross(placed.T @ one(axis), x) for x in plain()]
    assert alike(found(robot, f"turn of the base's sensors {axis}"), torque_more(robot, *turned))


@pytest.mark.parametrize("axis", "xyz")
def test_a_place_is_where_the_accelerometer_sits_on_the_root(robot, axis):
    given = inverse_dynamics(robot, read(robot, *plain()).motion)
    name = f"place of the accelerometer {axis}"
    more = found(robot, name)
    model = robot.model.copy()
    model.frames[model.getFrameId("imu")].placement.translation += one(axis)
    elsewhere = replace(robot, model=model)
    assert alike(more, (inverse_dynamics(robot, read(elsewhere, *plain()).motion) - given) / SMALL)


def test_a_delay_is_undone_by_later_readings(robot):
    later = waves(late=SMALL), waves(late=SMALL, order=1), 9.0 + 3.0 * waves(late=0.05 + SMALL)
    more = found(robot, "delay of the base's sensors")
    expected = torque_more(robot, *later)
    # The log's rate of 1000 Hz gives derivatives of sines of 5 Hz to a thousandth.
    np.testing.assert_allclose(more[1:-1], expected[1:-1], rtol=0, atol=2e-3 * np.abs(expected).max())


def test_errors_of_given_sizes_add_up(robot):
    log = read(robot, *plain())
    each = torque_per_base_error(robot, log, log.motion)
    sizes = [(name, 0.3 + k) for k, name in enumerate(SENSOR_ERRORS)]
    np.testing.assert_allclose(
        torque_of_base_errors(robot, log, sizes), sum(size * each[name] for name, size in sizes), rtol=0, atol=1e-9
    )
