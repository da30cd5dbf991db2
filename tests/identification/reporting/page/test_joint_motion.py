from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from identification.reporting.page.explaining import joint_motions
from phantom_dyn.dynamics.tree_motion import joint_velocity
from phantom_dyn.model.loading import load_robot
from phantom_dyn.motion import Motion


def test_active_joints_move_as_recorded(made_up):
    diagnosis = made_up(samples=50)
    assert joint_motions(None, diagnosis)["j2"].v == pytest.approx(diagnosis.evidence.v[:, 1])


def test_a_passive_joint_that_a_finding_names_moves_as_the_chain_makes_it(made_up):
    robot = load_robot("phantom_1_5")
    diagnosis = made_up(robot.joint_names, samples=50)
    named = dataclasses.replace(diagnosis.findings[0], joint="elbow")
    diagnosis = dataclasses.replace(diagnosis, findings=(named,))
    evidence = diagnosis.evidence
    motion = Motion(evidence.t, evidence.q, evidence.v, evidence.a)
    found = joint_motions(robot, diagnosis)["elbow"]
    assert found.v == pytest.approx(joint_velocity(robot, motion, "elbow")[0])
    # Finite differences of the position over the samples of one recording.
    assert np.gradient(found.q[:25], evidence.t[:25])[1:-1] == pytest.approx(found.v[1:24], rel=0.02, abs=1e-3)


def test_passive_joints_that_no_finding_names_cost_nothing(made_up):
    robot = load_robot("phantom_1_5")
    assert set(joint_motions(robot, made_up(robot.joint_names, samples=50))) == set(robot.joint_names)
