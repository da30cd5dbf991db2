"""Bases that are mounted in another way than the model's gravity says. Oracle: known truth; the gravity is put in."""

import re

import numpy as np
import pinocchio as pin
import pytest

from identification.data.checks.check_recording import checked
from identification.data.checks.readings.reading import reading_of
from identification.data.checks.readings.weights import attitude_suspects
from identification.data.checks.smoothed_copy import smoothed
from phantom_dyn.effects.support.changed_robot import with_gravity


@pytest.mark.parametrize("gravity", [(0.0, 0.0, 9.81), (9.81, 0.0, 0.0), (5.0, 0.0, 8.44)])
def test_a_robot_that_hangs_or_leans_far_is_refused_with_its_gravity(clean, planar2, gravity):
    # Known truth: the recorded robot feels this gravity, the given model 9.81 m/s^2 downwards.
    hanging = with_gravity(planar2, np.array(gravity))
    (fault,) = checked(clean(robot=hanging), planar2).wrong
    assert fault.what == "the base is mounted in another way than gravity in the model says"
    stated = re.search(r"write gravity: \[(.*)\] into robot.yaml", fault.mend)[1]
    np.testing.assert_allclose([float(x) for x in stated.split(",")], gravity, atol=0.3)


@pytest.mark.parametrize("degrees", [0.0, 20.0])
def test_a_base_that_leans_a_little_is_for_the_diagnosis(clean, planar2, degrees):
    turned = pin.exp3(np.array([0.0, np.radians(degrees), 0.0])) @ np.array([0.0, 0.0, -9.81])
    reading = reading_of(smoothed(clean(robot=with_gravity(planar2, turned))))
    assert attitude_suspects(planar2, reading) == []
