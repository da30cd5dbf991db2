"""Which recordings in one sine are judged; oracle: odd harmonics of a square wave in closed form."""

from dataclasses import replace

import numpy as np
import pytest

from identification.data.log import Log
from identification.data.recording import Recording
from identification.data.signals import process
from identification.diagnosis.columns.motion.one_sine import in_one_sine, moving, two_numbers_beside_more
from phantom_dyn.model.loading import load_robot
from places import ROBOTS


@pytest.fixture(scope="module")
def pendulum():
    return load_robot(ROBOTS / "pendulum.urdf")


def swung(robot, *hertz: float, edge_hz: float = 5.0) -> Log:
    t = np.arange(4000) / 200.0
    q = sum(0.3 * np.sin(2 * np.pi * f * t) for f in hertz)[:, None]
    log = process(Recording("bench.csv", robot.joint_names, t, q, np.cos(q)), robot)
    return replace(log, band=replace(log.band, cutoff_hz=edge_hz))


def few(*logs: Log) -> list[bool]:
    return two_numbers_beside_more(logs, moving(logs))[:, 0].tolist()


@pytest.mark.parametrize(("hertz", "harmonic_is_seen"), [(1.6, True), (1.8, False)])
def test_a_sine_without_its_third_harmonic_is_not_judged_beside_more(pendulum, hertz, harmonic_is_seen):
    # A square wave of friction has lines at 1, 3, 5 times its frequency; the band ends at 5 Hz.
    assert few(swung(pendulum, hertz), swung(pendulum, 0.5, 1.3)) == [not harmonic_is_seen, False]


def test_a_sine_is_judged_where_there_is_nothing_else(pendulum):
    assert few(swung(pendulum, 1.8), swung(pendulum, 2.1)) == [False, False]


def test_a_recording_in_which_a_joint_rests_is_no_other_motion(pendulum):
    logs = (swung(pendulum, 1.8), at_rest(swung(pendulum, 1.8)))
    assert few(*logs) == [False, False]
    assert in_one_sine(logs, moving(logs)) == {0}


def at_rest(log: Log) -> Log:
    """The same log with its joint at rest."""
    still = np.zeros_like(log.motion.q)
    return replace(log, motion=replace(log.motion, q=still, v=still, a=still))
