"""When a row is judged on a base that is not bolted down. Oracle: times that were put in."""

from dataclasses import replace

import numpy as np
import pytest

from floating_leg import log_of_leg, written_leg
from identification.data.floating.swings import band_of_swings, require_swings, touched_rows
from identification.data.reading import recording
from identification.data.recording import Table
from identification.data.signals import process
from identification.data.unknown_drives import with_model_torque
from identification.diagnosis.noise.reading_noise import ReadingNoise
from identification.diagnosis.noise.sensor_floor import reading_error_torque
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.errors import LogError
from phantom_dyn.model.loading import load_robot


@pytest.fixture
def stepping(tmp_path, rng):
    """A robot, and its recording at 500 Hz whose foot stands from 0.6 to 1.2 s, 1.8 to 2.4 s, and so on."""
    file = written_leg(tmp_path)
    robot = load_robot(file)
    return robot, recording(Table("log.csv", log_of_leg(file, rng, steps=True)), robot)


def standing(t):
    return (t % 1.2) > 0.6


def test_no_row_is_free_while_the_foot_stands_nor_a_fiftieth_of_a_second_around_it(stepping):
    robot, log = stepping
    touched = touched_rows(log, robot, log.t)
    assert touched is not None
    near = np.any([standing(log.t + shift) for shift in np.linspace(-0.019, 0.019, 20)], axis=0)
    far = ~np.any([standing(log.t + shift) for shift in np.linspace(-0.023, 0.023, 20)], axis=0)
    inside = (log.t > 0.1) & (log.t < log.t[-1] - 0.1)
    assert touched[near & inside].all()
    assert not touched[far & inside].any()


def test_an_impact_of_another_foot_leaves_out_a_moment_of_every_row(stepping):
    robot, log = stepping
    # The thigh alone carries that frame: the knee is free but for the impacts.
    contacts = {"thigh": log.base.contacts["foot"]}
    touched = touched_rows(replace(log, base=replace(log.base, contacts=contacts)), robot, log.t)
    assert touched is not None
    assert touched[:, 0].mean() > 0.5
    changes = 2 * log.t[-1] / 1.2
    assert touched[:, 1].sum() == pytest.approx(0.022 * 500 * changes, rel=0.1)


def test_the_band_of_a_swing_of_half_a_second_holds_its_filter_once_and_half(stepping):
    robot, log = stepping
    # Of 0.6 s a fiftieth is left out at both ends.
    assert band_of_swings((log,), robot, 5.0) == pytest.approx(6 / 0.56, rel=0.02)


def test_a_band_of_swings_is_no_lower_than_that_of_the_motion_up_to_a_limit(stepping):
    robot, log = stepping
    assert band_of_swings((log,), robot, 15.0) == 15.0
    assert band_of_swings((log,), robot, 60.0) == 20.0


def test_a_robot_that_hangs_has_no_edge_of_swings(stepping, tmp_path, rng):
    robot, _ = stepping
    hanging = recording(Table("log.csv", log_of_leg(tmp_path / "robot.urdf", rng)), robot)
    assert band_of_swings((hanging,), robot, 5.0) is None


def test_samples_in_the_band_are_free_where_the_whole_filter_is(stepping):
    robot, recorded = stepping
    log = process(recorded, robot, cutoff_hz=20.0)
    at = log.motion.t[log.samples][3:-3]
    reach = log.band.half / log.band.rate_hz
    # Two samples less than the margin: the times of contacts are those of samples.
    whole = np.linspace(-reach - 0.016, reach + 0.016, 99)
    free = ~np.any([standing(at + shift) for shift in whole], axis=0)
    found = log.untouched_in_band[3:-3, 1]
    assert not found[~free].any()
    assert found[free].mean() > 0.9
    assert free.sum() > 100


def test_swings_shorter_than_the_filter_are_refused(stepping):
    robot, recorded = stepping
    log = process(recorded, robot, cutoff_hz=5.0)
    with pytest.raises(LogError, match=r"no joint is free of contacts for 0\.8 s, which the filter needs at 500 Hz"):
        require_swings((log,))


def test_where_the_foot_stands_the_torque_is_that_of_the_model(stepping):
    robot, recorded = stepping
    log = process(recorded, robot, cutoff_hz=20.0)
    found = with_model_torque(robot, log)
    np.testing.assert_array_equal(found.tau[log.touched], inverse_dynamics(robot, log.motion)[log.touched])
    np.testing.assert_array_equal(found.tau[~log.touched], log.tau[~log.touched])
    assert np.abs(log.tau - found.tau)[log.touched].max() > 10.0


def with_noise(log, of_accelerometer):
    assert log.base_sensors is not None
    return replace(log, base_sensors=replace(log.base_sensors, noise=(0.0, of_accelerometer)))


def test_the_noise_of_the_bases_sensors_is_noise_of_the_torque(stepping):
    robot, recorded = stepping
    log = process(recorded, robot, cutoff_hz=20.0)
    readings = (ReadingNoise(0.0, 0.0),) * 2
    quiet = reading_error_torque(robot, with_noise(log, 0.0), readings, np.random.default_rng(1))
    noisy = reading_error_torque(robot, with_noise(log, 0.3), readings, np.random.default_rng(1)) - quiet
    # A mass point of 0.4 kg, 0.1 m from the knee, in a noise of 0.3 m/s^2 up to 50 of 250 Hz.
    assert np.std(noisy[:, 1]) == pytest.approx(0.4 * 0.1 * 0.3 * np.sqrt(50 / 250), rel=0.1)
