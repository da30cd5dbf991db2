"""What a voltage that is read once a frame leaves open. Oracle: the loop by its equation at 4 kHz, known truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identification.data.drives.arrivals import arrival_notes, between_readings, with_open_arrivals
from identification.data.reading import recording
from identification.data.recording import Recording, Table
from identification.data.signals import process
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Robot
from places import ROBOTS

GAIN, PER_VOLT, FRAME, FINE = 24.0, 0.5, 0.02, 80  # V/rad, N m/V, s, steps of the oracle in a frame


def moving(t: np.ndarray) -> np.ndarray:
    return 0.6 * np.sin(1.9 * t) + 0.3 * np.sin(4.1 * t)


@pytest.fixture(scope="module")
def robot() -> Robot:
    """A rod on a motor of 0.5 N m/V whose references are held."""
    found = load_robot(ROBOTS / "pendulum.urdf")
    drive = replace(found.actuators[0], torque_constant=1.0, resistance=2.0)
    return replace(found, actuators=(drive,), reference_hold="zoh")


def servo(delay: float, drops_beyond: float = np.inf) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, motion and voltage at 4 kHz of a loop whose references are sent every frame and arrive later.

    Beyond an error it puts out no more than a volt.
    """
    t = np.arange(1000 * FINE + 1) * FRAME / FINE
    arrived = np.floor((t - delay) / FRAME + 1e-9) * FRAME
    q = 0.9 * moving(t - 0.1)
    error = moving(np.maximum(arrived, 0.0)) - q
    return t, q, np.where(np.abs(error) > drops_beyond, np.clip(GAIN * error, -1.0, 1.0), GAIN * error)


def read_once_a_frame(robot: Robot, delay: float, columns: dict | None = None, beyond: float = np.inf) -> Recording:
    t, q, u = (x[::FINE] for x in servo(delay, beyond))
    # In steps of a register.
    table = {"t": t, "q.pin": q, "q_ref.pin": moving(t), "u.pin": np.round(u, 2), **(columns or {})}
    return recording(Table("a.csv", table), robot)


@pytest.mark.parametrize("delay", [0.023, 0.031, 0.038])
def test_the_mean_of_a_frame_is_off_its_readings_by_a_part_of_a_frame(robot, delay):
    # The next reference comes at delay, and the line through the readings is of one that comes in whole frames.
    _, _, u = servo(delay)
    means = np.convolve(u, np.ones(FINE) / FINE, "same")[::FINE]
    one = read_once_a_frame(robot, delay)
    assert one.voltage is not None
    lines = np.convolve(one.voltage[:, 0], [0.125, 0.75, 0.125], "same")
    found = between_readings(one, robot, one.t, held=True)
    assert found is not None
    column = found.arrival[:, 0]
    part = delay / FRAME % 1.0 - 0.5
    inner = slice(20, -20)
    off = PER_VOLT * (means - lines) - part * column
    assert np.std(off[inner]) < 0.1 * 0.5 * np.std(column[inner])


@pytest.mark.parametrize("delay", [0.023, 0.031, 0.037])
def test_a_drive_that_protects_itself_is_followed_between_its_readings(robot, delay):
    # Where it drops its voltage in a frame, the line through the readings is off by up to 0.5 N m.
    _, _, u = servo(delay, 0.1)
    one = read_once_a_frame(robot, delay, beyond=0.1)
    assert one.voltage is not None
    means = np.convolve(u, np.ones(FINE) / FINE, "same")[::FINE]
    off = PER_VOLT * (means - np.convolve(one.voltage[:, 0], [0.125, 0.75, 0.125], "same"))
    found = between_readings(one, robot, one.t, held=True)
    assert found is not None
    left = off - found.torque[:, 0] - (delay / FRAME % 1.0 - 0.5) * found.arrival[:, 0]
    inner = slice(20, -20)
    assert np.std(left[inner]) < 0.4 * np.std(off[inner])
    # What is left lies where it is doubted.
    assert np.all(np.abs(left[inner]) < 3.0 * np.abs(found.doubt[inner, 0]) + 0.03)
    assert np.mean(np.abs(found.doubt) > 0.03) < 0.25


def test_a_drive_without_protection_leaves_no_doubt(robot):
    one = read_once_a_frame(robot, 0.031)
    found = between_readings(one, robot, one.t, held=True)
    assert found is not None
    assert not found.torque.any()
    assert not found.doubt.any()


def test_a_warm_motor_makes_less_of_it(robot):
    # By hand: 40 K above its coldest copper has 0.393 % times 40 more resistance.
    t = np.arange(1001) * FRAME
    cold, warm = (
        between_readings(read_once_a_frame(robot, 0.031, columns), robot, t, held=True)
        for columns in ({}, {"temp.pin": np.linspace(25.0, 65.0, len(t))})
    )
    assert cold is not None
    assert warm is not None
    np.testing.assert_allclose(warm.arrival[0], cold.arrival[0], atol=1e-12)
    np.testing.assert_allclose(warm.arrival[-1] * (1.0 + 0.00393 * 40.0), cold.arrival[-1], atol=1e-12)


def test_an_instant_reference_leaves_nothing_open(robot):
    one = read_once_a_frame(robot, 0.031)
    assert between_readings(one, robot, one.t, held=False) is None


def test_a_voltage_that_was_computed_leaves_nothing_open(robot):
    t = np.arange(1001) * FRAME
    one = read_once_a_frame(robot, 0.031, {"u.pin": GAIN * (moving(t) - 0.9 * moving(t - 0.1))})
    assert between_readings(one, robot, one.t, held=True) is None


def test_a_torque_in_place_of_a_voltage_leaves_nothing_open(robot):
    one = read_once_a_frame(robot, 0.031, {"tau.pin": np.sin(np.arange(1001) * FRAME)})
    assert between_readings(one, robot, one.t, held=True) is None


def test_the_joint_is_named_with_the_friction_that_looks_the_same(robot):
    # By hand: half a frame of 20 ms times 24 V/rad times 0.5 N m/V.
    one = read_once_a_frame(robot, 0.031)
    left_open = with_open_arrivals(robot, (process(one, robot),))
    (note,) = arrival_notes(left_open, (one,))
    assert left_open.open_arrivals == ("pin",)
    assert note.numbers["viscous"] == pytest.approx(0.01 * 24 * 0.5, rel=0.01)


def test_robots_whose_references_act_at_once_have_no_such_joint(robot):
    one = read_once_a_frame(replace(robot, reference_hold=None), 0.031)
    assert with_open_arrivals(robot, (process(one, replace(robot, reference_hold=None)),)).open_arrivals == ()
