"""Fits of a robot like its model to a torque. Oracle: closed forms, and the residual of a right recording."""

from dataclasses import replace

import numpy as np

from identification.data.checks.readings.plausible_fit import unexplained, with_fewer_rows
from identification.data.checks.readings.reading import of_voltages, reading_of
from identification.data.checks.smoothed_copy import smoothed
from identification.data.recording import Recording
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Actuator
from places import ROBOTS


def test_a_right_recording_leaves_next_to_nothing_unexplained(clean, arm):
    # What is left is that of smoothing a sharp change of friction.
    reading = reading_of(smoothed(clean(friction=3.0)))
    assert unexplained(arm, reading).max() < 5e-3


def test_a_torque_computed_from_a_voltage_may_lack_a_part_of_the_back_emf(clean):
    # Closed form: kt^2 / R = 2 N m s/rad of back-EMF; four fifths of it were taken off too much.
    robot = load_robot(ROBOTS / "pendulum.urdf")
    robot = replace(robot, actuators=(Actuator(torque_constant=2.0, resistance=2.0),))
    recording = clean(robot=robot)
    copy = smoothed(recording)
    reading = reading_of(smoothed(replace(recording, tau=recording.tau - 1.6 * smooth_velocity(recording))))
    assert unexplained(robot, reading).max() > 0.03
    assert unexplained(robot, of_voltages(reading, robot, {"pin": "tau"}, copy.step)).max() > 0.03
    assert unexplained(robot, of_voltages(reading, robot, {"pin": "u"}, copy.step)).max() < 0.01


def smooth_velocity(recording: Recording) -> np.ndarray:
    return np.gradient(recording.q, recording.t, axis=0)


def test_few_rows_have_the_same_sum_of_squares_of_every_residual(rng):
    # Closed form: an orthogonal transform keeps the length of columns @ x - target for any x.
    shared, own, target = (rng.standard_normal((400, *rest)) for rest in ((3, 6), (3, 4), (3,)))
    x, y = rng.standard_normal(6), rng.standard_normal((3, 4))

    def squares(shared: np.ndarray, own: np.ndarray, target: np.ndarray) -> np.ndarray:
        return np.sum((shared @ x + np.einsum("nkc,kc->nk", own, y) - target) ** 2, axis=0)

    few = with_fewer_rows(shared, own, target)
    assert len(few[2]) == 11
    np.testing.assert_allclose(squares(*few), squares(shared, own, target), rtol=1e-12)
