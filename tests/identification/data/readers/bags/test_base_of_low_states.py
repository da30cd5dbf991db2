"""What Unitree's LowState says of the base. Oracle: the numbers that were put in."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from identification.data.readers.bags.base_of_low_states import FEET, base_columns, base_of, threshold

N = 200
ON = (np.arange(N) // 20) % 2 == 1


def message(k: int) -> SimpleNamespace:
    imu = SimpleNamespace(gyroscope=[0.1 * k, 1, 2], accelerometer=[3, 4, 9 + 0.01 * k])
    return SimpleNamespace(imu_state=imu, foot_force=[20 + 90 * ON[k] + k % 3 + j for j in range(4)])


def test_the_sensor_is_at_the_link_imu():
    columns, _ = base_columns("bag", [base_of(message(k)) for k in range(N)])
    np.testing.assert_allclose(columns["w.imu.x"], 0.1 * np.arange(N))
    np.testing.assert_allclose(columns["sf.imu.z"], 9 + 0.01 * np.arange(N))


def test_a_foot_is_on_the_ground_beyond_halfway_between_two_levels_and_that_is_said():
    columns, told = base_columns("bag", [base_of(message(k)) for k in range(N)])
    for foot in FEET:
        np.testing.assert_array_equal(columns[f"contact.{foot}"], ON)
    assert told[0].startswith("bag: a foot counts as on the ground from a force on of 66 of FR_foot, 67 of FL_foot")


@pytest.mark.parametrize("force", [np.full(N, 12.0), 20 + np.random.default_rng(0).normal(size=N), np.full(N, np.nan)])
def test_a_force_without_two_levels_says_nothing_of_contact(force):
    assert threshold(force) is None


def test_without_forces_of_feet_there_is_the_sensor_alone():
    message_of_humanoid = SimpleNamespace(imu_state=message(1).imu_state)
    columns, told = base_columns("bag", [base_of(message_of_humanoid)] * N)
    assert sorted(columns) == ["sf.imu.x", "sf.imu.y", "sf.imu.z", "w.imu.x", "w.imu.y", "w.imu.z"]
    assert told == ()


def test_the_older_message_has_other_names():
    old = SimpleNamespace(imu=message(3).imu_state, footForce=[1, 2, 3, 4])
    np.testing.assert_allclose(base_of(old), [0.3, 1, 2, 3, 4, 9.03, 1, 2, 3, 4])


def test_a_sensor_that_reads_nothing_gives_no_column():
    silent = SimpleNamespace(gyroscope=[0, 0, 0], accelerometer=[0, 0, 0])
    one = SimpleNamespace(imu_state=silent, foot_force=[0, 0, 0, 0])
    assert base_columns("bag", [base_of(one)] * N) == ({}, ())
