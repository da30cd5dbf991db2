"""Slopes of the predicted poses. Oracle: central differences of what is left, and forward kinematics of a URDF that was
changed as text, written without Pinocchio."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from identification.geometry.equations import DELAY, Estimate, PoseProblem, changed_model, equations, nuisances_of
from identification.geometry.fit import moved, start_of
from identification.geometry.measured import measured_poses
from identification.geometry.terms import LINK, terms_of
from tests.common.measured_poses import link_poses, moved_joint


@pytest.fixture
def problem(ur10, tracked, slow_motion) -> PoseProblem:
    t, q = slow_motion
    sets, paths = measured_poses(ur10, (tracked(1, q=q, t=t, turned=True, zeros={"elbow_joint": 0.01}),))
    sets = tuple(one.some(np.arange(0, len(one.t), 100)) for one in sets)
    return PoseProblem(ur10, sets, paths, terms_of(ur10, ["tool0"]))


def test_columns_of_nuisances_are_the_slopes_where_nothing_is_left(problem):
    start = start_of(problem)
    exact = _without_rest(problem, start)
    kinds, step, found = nuisances_of(problem), 1e-6, equations(exact, start)
    for k, kind in enumerate(kinds):
        way = step * (np.arange(len(kinds)) == k)
        up, down = (equations(exact, moved(kinds, start, (), sign * way)).left for sign in (1, -1))
        # The velocity of a column is low-passed, that of the path is not.
        close = 1e-2 if kind.kind == DELAY else 1e-6
        np.testing.assert_allclose((down - up) / (2 * step), found.nuisance[:, k], atol=close)


def test_columns_of_terms_are_the_slopes_where_nothing_is_left(problem):
    start = replace(start_of(problem), delay=(0.0,))
    exact = _without_rest(problem, start)
    found, step = equations(exact, start), 1e-6
    assert np.abs(found.left).max() < 1e-12
    for k in range(len(problem.terms)):
        size = step * (1e-3 if problem.terms[k].parameter == "compliance" else 1.0)
        way = size * (np.arange(len(problem.terms)) == k)
        up, down = (equations(exact, replace(start, values=sign * way)).left for sign in (1, -1))
        scale = max(1.0, np.abs(found.columns[:, k]).max())
        np.testing.assert_allclose((down - up) / (2 * size), found.columns[:, k], atol=1e-6 * scale)


def _without_rest(problem: PoseProblem, estimate: Estimate) -> PoseProblem:
    """The same with poses that are what is predicted."""
    one = problem.sets[0]
    base, tool = pin.SE3(estimate.base[0]), pin.SE3(estimate.tool[0])
    model, data = problem.robot.model, problem.robot.model.createData()
    poses = []
    for q in one.q:
        pin.framesForwardKinematics(model, data, q)
        poses.append(base * data.oMf[one.index] * tool)
    position = np.array([pose.translation for pose in poses])
    turn = np.array([pin.Quaternion(pose.rotation).coeffs() for pose in poses])
    return replace(problem, sets=(replace(one, position=position, turn=turn),))


@pytest.mark.parametrize("joint", ["shoulder_lift_joint", "elbow_joint", "wrist_3_joint"])
def test_a_changed_model_is_that_of_the_urdf_with_another_origin(ur10, ur10_text, rng, joint):
    terms = tuple(term for term in terms_of(ur10, ["tool0"]) if term.joint == joint and term.effect == LINK)
    values = 0.05 * rng.standard_normal(len(terms))
    model = changed_model(ur10.model, terms, values)
    twist = np.zeros(6)
    for term, value in zip(terms, values, strict=True):
        twist[term.part] = value
    # A twist moves along a screw; its rotation vector and shift as a pose.
    place = pin.exp6(twist)
    q = rng.uniform(-2, 2, 6)
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    text = moved_joint(ur10_text, joint, place.translation, pin.log3(place.rotation))
    there = link_poses(text, dict(zip(ur10.joint_names, q, strict=True)))["tool0"]
    np.testing.assert_allclose(data.oMf[model.getFrameId("tool0")].homogeneous, there, atol=1e-9)
