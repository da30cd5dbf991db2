# pyright: reportAttributeAccessIssue=false
"""Nearest possible bodies. Oracles: closed forms, the eigenvalues of the pseudo-inertia, and MuJoCo on the file."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identification.diagnosis.result import Finding, Value
from identification.export.all_files import export_texts, not_held
from identification.export.corrected.nearest_bodies import nearest_possible, with_nearest_bodies
from identification.words.note_words import sentence, sentences
from phantom_dyn.effects.support.changed_robot import with_parameters
from phantom_dyn.errors import ParameterError
from phantom_dyn.model.inertia import body_parameters, breaks_triangle, central_parameters, impossible_because


def moved(planar, **entries: float):
    """The arm with other parameters of its lower link."""
    names = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
    change = np.zeros(20)
    for name, value in entries.items():
        change[10 + names.index(name)] = value
    return with_parameters(planar, change)


def test_a_possible_body_is_nearest_to_itself():
    body = body_parameters(2.0, np.array([0.1, 0.0, 0.2]), np.diag([0.02, 0.03, 0.04]))
    found, distance = nearest_possible(body, 0.1)
    np.testing.assert_allclose(found, body, atol=1e-12)
    assert distance < 1e-12


def test_a_negative_moment_is_taken_away_and_nothing_else():
    # Second moments about the centre, which is at the origin: 0.03, 0.02 and -0.01 kg m^2.
    second = np.diag([0.03, 0.02, -0.01])
    inertia = np.trace(second) * np.eye(3) - second
    found, distance = nearest_possible(body_parameters(1.0, np.zeros(3), inertia), 1.0)
    wanted = np.diag([0.02, 0.03, 0.05])
    np.testing.assert_allclose(central_parameters(found)[2], wanted, atol=3e-6)
    assert distance == pytest.approx(0.01 / np.sqrt(1 + 0.03**2 + 0.02**2 + 0.01**2), rel=1e-3)


def test_bodies_that_did_not_move_stay_as_they_were_given(planar):
    assert with_nearest_bodies(planar, planar) == (planar, ())


def test_what_no_body_can_have_becomes_possible_and_is_told(planar):
    robot, told = with_nearest_bodies(moved(planar, Iyy=3.0), planar)
    mass, _, inertia = central_parameters(robot.model.inertias[2].toDynamicParameters())
    assert impossible_because(mass, inertia) is None
    assert not breaks_triangle(inertia)
    assert len(told) == 1
    assert sentence(told[0]).startswith("No body can have the inertia that was found for lower")


def test_a_link_without_weight_is_refused(planar):
    robot = replace(planar, model=planar.model.copy())
    inertia = robot.model.inertias[2]
    inertia.mass = -0.1
    robot.model.inertias[2] = inertia
    with pytest.raises(ParameterError, match=r"lower would weigh -0\.1 kg"):
        with_nearest_bodies(robot, planar)


def test_a_finding_that_no_body_can_have_is_written_as_a_possible_one(planar, made_up, tmp_path):
    size = {"elbow.Iyy": Value(3.0, 0.1, "kg m^2"), "elbow.m": Value(0.2, 0.01, "kg")}
    diagnosis = made_up(("shoulder", "elbow"), findings=1, samples=400)
    finding = replace(diagnosis.findings[0], effect="inertial_parameters", joint="elbow", parameters=size, loadings=())
    assert isinstance(finding, Finding)
    texts, noted = export_texts(replace(diagnosis, findings=(finding,), adjusted=()), planar, folder=tmp_path)
    assert "corrected.xml" in texts
    assert "corrected.urdf" in texts
    assert any("No body can have" in text for text in sentences(not_held(noted.notes)))
