"""Diagnoses of real recordings against published values and what their authors say of the robots."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from identification.data.recording import Recording
from identification.diagnosis.result import Diagnosis
from identification.pipeline import diagnose
from phantom_dyn import load_robot


def places(diagnosis: Diagnosis) -> list[tuple[str, str | None]]:
    return [(finding.effect, finding.joint) for finding in diagnosis.findings]


@pytest.fixture(scope="module")
def emps(data_folder: Path) -> Diagnosis:
    data = np.load(data_folder / "emps" / "emps_train.npz")
    recording = Recording("emps", ("axis",), data["t"], data["q_meas"][:, None], data["force"][:, None])
    return diagnose(load_robot("emps"), (recording,))


def test_emps_has_direction_dependent_friction(emps):
    assert places(emps) == [("direction_dependent_friction", "axis")]
    assert emps.findings[0].probability > 0.5
    assert emps.findings[0].gap_closed > 0.9


def test_rivals_of_emps_are_friction_on_the_same_axis(emps):
    effects = {effect.effect for rival in emps.findings[0].rivals for effect in rival.effects}
    assert effects <= {"coulomb_friction", "viscous_friction", "torque_offset", "stribeck_friction"}


@pytest.mark.parametrize(
    ("name", "published", "accuracy"),
    [
        ("torque_positive", 20.1440, 0.03),
        ("torque_negative", 20.6277, 0.03),
        ("coefficient_positive", 166.7061, 0.02),
        ("coefficient_negative", 240.4236, 0.02),
    ],
)
def test_the_published_friction_of_emps_comes_back(emps, name, published, accuracy):
    # Janot, Gautier and Brunot 2019: direction-dependent friction of the axis.
    assert emps.findings[0].parameters[name].value == pytest.approx(published, rel=accuracy)


@pytest.fixture(scope="module")
def ur10(data_folder: Path) -> Diagnosis:
    data = np.load(data_folder / "ur10_unisa" / "ur10_exc.npz")
    robot = load_robot("example:ur10")
    recording = Recording("ur10", robot.joint_names, data["t"], data["q"].astype(float), data["effort"].astype(float))
    return diagnose(robot, (recording,))


FRICTION = {"viscous_friction", "coulomb_friction", "direction_dependent_friction", "stribeck_friction"}


def test_every_joint_of_the_ur10_has_friction(ur10):
    # Published: refitting friction lowers the error of each joint to a third at most.
    assert {joint for effect, joint in places(ur10) if effect in FRICTION} == {j.joint for j in ur10.joints}


def test_the_inertias_of_the_ur10s_file_are_wrong(ur10):
    assert "inertial_parameters" in {effect for effect, _ in places(ur10)}


def test_the_ur10_carries_nothing_and_has_no_spring(ur10):
    # Both lower the error a little; the inertias explain what they would.
    assert not {"payload", "parasitic_spring"} & {effect for effect, _ in places(ur10)}


def double_pendulum(data_folder: Path, model: str) -> Diagnosis:
    folder = data_folder / "dfki_double_pendulum"
    robot, data = load_robot(folder / model), np.load(folder / "C1_sysid.npz")
    runs = sorted({name.split("__")[0] for name in data})
    recordings = [
        Recording(run, robot.joint_names, data[f"{run}__t"], data[f"{run}__q"], data[f"{run}__tau_meas"])
        for run in runs
    ]
    return diagnose(robot, tuple(recordings))


def test_both_joints_of_the_double_pendulum_have_coulomb_friction(data_folder):
    # Published: Coulomb torques of 0.16 and 0.12 that the model does not have.
    found = double_pendulum(data_folder, "C1_model.urdf")
    assert {joint for effect, joint in places(found) if effect == "coulomb_friction"} == {j.joint for j in found.joints}


def test_inertias_counted_twice_are_inertial_parameters_and_no_missing_friction(data_folder):
    # The authors' file holds the published friction already, and m r^2 twice.
    found = double_pendulum(data_folder, "design_C1_identified.urdf")
    effects = {effect for effect, _ in places(found)}
    assert "inertial_parameters" in effects
    assert "coulomb_friction" not in effects
