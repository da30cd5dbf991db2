"""Torque from the voltage of a motor that warms. Oracle: the closed form of its circuit with copper's 0.393 % per K."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identification.data.reading import recording
from identification.data.recording import Recording, Table
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Robot
from places import ROBOTS

T = np.arange(1000) / 100.0
Q, V = np.sin(T), np.cos(T)
U = 3.0 * np.sin(2.0 * T)
K, R = 1.5, 2.0


@pytest.fixture(scope="module")
def robot() -> Robot:
    found = load_robot(ROBOTS / "pendulum.urdf")
    return replace(found, actuators=(replace(found.actuators[0], torque_constant=K, resistance=R),))


def read(robot: Robot, **columns: np.ndarray) -> Recording:
    return recording(Table("a.csv", {"t": T, "q.pin": Q, "v.pin": V, "u.pin": U, **columns}), robot)


def test_copper_takes_its_part_of_current_and_back_emf(robot):
    warm = np.linspace(25.0, 65.0, len(T))
    found = read(robot, **{"temp.pin": warm})
    assert found.tau is not None
    np.testing.assert_allclose(found.tau[:, 0], K * (U - K * V) / (R * (1.0 + 0.00393 * (warm - 25.0))), rtol=1e-12)


def test_the_resistance_that_is_taken_is_said(robot):
    # By hand: 2 ohm grow by 0.393 % times 40 K.
    (said,) = (one for one in read(robot, **{"temp.pin": np.linspace(25.0, 65.0, len(T))}).warnings if "copper" in one)
    assert "to grow from the stated 2 to 2.31 ohm" in said


@pytest.mark.parametrize("warm", [31.0, 0.0])
def test_at_one_temperature_the_resistance_is_the_stated_one(robot, warm):
    # One that was fitted is that of the motor as it ran.
    found = read(robot, **{"temp.pin": np.full(len(T), warm)})
    np.testing.assert_array_equal(found.tau, read(robot).tau)
    assert not any("copper" in one for one in found.warnings)


def test_a_measured_torque_does_not_depend_on_the_temperature(robot):
    found = read(robot, **{"tau.pin": U, "temp.pin": np.full(len(T), 80.0)})
    assert found.tau is not None
    np.testing.assert_array_equal(found.tau[:, 0], U)
    assert not any("copper" in one for one in found.warnings)


def test_a_computed_voltage_follows_its_reference_with_less_torque(robot):
    # By hand: 24 V/rad times 0.75 N m/V, less by the copper's 0.393 % per K, on average.
    q_ref, warm = np.sin(T + 0.1), np.linspace(25.0, 65.0, len(T))
    found = read(robot, **{"q_ref.pin": q_ref, "u.pin": 24.0 * (q_ref - Q), "temp.pin": warm})
    assert found.follows is not None
    assert found.follows[0] == pytest.approx(24.0 * K / R * np.mean(1.0 / (1.0 + 0.00393 * (warm - 25.0))), rel=1e-6)
