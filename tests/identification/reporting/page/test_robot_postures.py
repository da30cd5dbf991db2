# pyright: reportAttributeAccessIssue=false
"""Postures of the report's robot. Oracle: forward kinematics by Pinocchio."""

from __future__ import annotations

import dataclasses

import numpy as np
import pinocchio as pin
import pytest

from identification.reporting.page.robot_scene import SHOWN, postures
from phantom_dyn.errors import ChainError
from phantom_dyn.model.loading import load_robot


def places(robot, q) -> np.ndarray:
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    return np.array([pose.translation for pose in data.oMi])


def test_the_middle_posture_is_that_of_the_middle_of_the_recording(made_up, planar2):
    diagnosis = made_up(planar2.joint_names, samples=101)
    found = postures(planar2, diagnosis)
    np.testing.assert_allclose(found.place[found.middle], places(planar2, diagnosis.evidence.q[50]), atol=1e-12)
    assert found.t[found.middle] == diagnosis.evidence.t[50]


def test_the_first_and_the_last_are_the_ends_of_the_recording(made_up, planar2):
    diagnosis = made_up(planar2.joint_names, samples=101)
    found = postures(planar2, diagnosis)
    assert len(found.t) == SHOWN
    for k in (0, -1):
        np.testing.assert_allclose(found.place[k], places(planar2, diagnosis.evidence.q[k]), atol=1e-12)


def test_samples_that_are_no_numbers_are_left_out(made_up, planar2):
    diagnosis = made_up(planar2.joint_names, samples=101)
    q = diagnosis.evidence.q.copy()
    q[:30] = np.nan
    found = postures(planar2, dataclasses.replace(diagnosis, evidence=dataclasses.replace(diagnosis.evidence, q=q)))
    assert found.t[0] == diagnosis.evidence.t[30]
    assert np.isfinite(found.place).all()


def test_without_samples_the_robot_stands_in_its_neutral_posture(made_up, planar2):
    diagnosis = made_up(planar2.joint_names, samples=4)
    evidence = dataclasses.replace(diagnosis.evidence, q=np.full((4, 2), np.nan))
    found = postures(planar2, dataclasses.replace(diagnosis, evidence=evidence))
    assert len(found.t) == 1
    np.testing.assert_allclose(found.place[0], places(planar2, pin.neutral(planar2.model)), atol=1e-12)


def test_loops_that_do_not_close_along_the_recording_leave_the_middle_posture_alone(made_up, monkeypatch):
    robot = load_robot("phantom_1_5")
    diagnosis = made_up(robot.joint_names, samples=101)
    close = type(robot).configuration

    def torn(self, q):
        if len(q) > 1:
            raise ChainError("torn")
        return close(self, q)

    monkeypatch.setattr(type(robot), "configuration", torn)
    found = postures(robot, diagnosis)
    assert (len(found.t), found.t[0]) == (1, pytest.approx(diagnosis.evidence.t[50]))


def test_moves_from_the_middle_carry_the_origins(made_up):
    robot = load_robot("phantom_1_5")
    found = postures(robot, made_up(robot.joint_names, samples=101))
    turned, shift = found.moved_from_the_middle()
    back = np.einsum("knij,nj->kni", turned, found.place[found.middle]) + shift
    np.testing.assert_allclose(back, found.place, atol=1e-12)
