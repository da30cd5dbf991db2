"""Numbers that a motion shows. Oracle: by hand, from the size of the arm."""

import numpy as np
import pytest

from identification.diagnosis.judge.findings.shown_numbers import moments_instead, only_shown, reach_of
from identification.diagnosis.result import Value


@pytest.fixture(scope="module")
def session(lab, planar2):
    motion = lab.motion(2, 3)
    return lab.prepared(planar2, (lab.recording(planar2, motion, np.zeros_like(motion.q)),)).session


def test_a_place_that_is_known_to_no_better_than_the_robot_is_large_is_not_shown(session, planar2):
    reach = reach_of(planar2)
    values = {"center_x": Value(0.1, 0.01 * reach, "m"), "center_y": Value(0.0, 2.0 * reach, "m")}
    found = only_shown(values, session, None)
    assert [value.shown for value in found.values()] == [True, False]
    assert found["center_x"] == values["center_x"]


def test_a_load_that_is_large_beside_the_robot_is_shown_by_its_own_size(session, planar2):
    moment = 10.0 * reach_of(planar2) * sum(float(inertia.mass) for inertia in planar2.model.inertias[1:])
    values = {"moment_x": Value(moment, 0.1 * moment, "kg m"), "moment_y": Value(0.0, 0.1 * moment, "kg m")}
    assert [value.shown for value in only_shown(values, session, None).values()] == [True, False]


def test_a_torque_whose_deviation_is_above_all_that_was_measured_is_not_shown(session, planar2):
    largest = max(float(np.abs(log.tau[:, 1]).max()) for log in session.logs)
    values = {"torque": Value([0.1, 0.2], [0.01, 2.0 * largest], "N m")}
    assert only_shown(values, session, "elbow")["torque"].std == [0.01, np.inf]


def test_of_a_mass_beside_moments_a_wide_interval_is_not_shown(session):
    # 95 % of a mass of 1 kg with a deviation of 0.2 kg are 0.78 kg wide, more than a half of it.
    moments = {"moment_x": Value(0.2, 0.01, "kg m")}
    assert not only_shown({"mass": Value(1.0, 0.2, "kg"), **moments}, session, None)["mass"].shown
    assert only_shown({"mass": Value(1.0, 0.1, "kg"), **moments}, session, None)["mass"].shown
    assert moments_instead(1.0, 0.2)
    assert not moments_instead(1.0, 0.1)
