"""Diagnoses of real recordings: EMPS, and nulls whose answer is known."""

from pathlib import Path

import numpy as np
import pytest

from identification.data.recording import Recording
from identification.diagnosis.result import Diagnosis
from identification.export.corrected.found_effects import effect_of
from identification.pipeline import diagnose
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Robot
from places import CHECKOUT


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


CERTAIN = 0.9


def judged_beside(robot: Robot, fitted: tuple[Recording, ...], judged: tuple[Recording, ...]) -> Diagnosis:
    """The diagnosis of recordings by a model that holds what was found on others."""
    found = diagnose(robot, fitted).findings
    assert found, "without a correction nothing is tested"
    return diagnose(robot, judged, known=tuple(effect_of(robot, finding) for finding in found))


def claims(diagnosis: Diagnosis) -> list[tuple[str, str | None]]:
    """What is said to be missing with a probability that a reader takes for certain."""
    return [(finding.effect, finding.joint) for finding in diagnosis.findings if finding.probability >= CERTAIN]


@pytest.fixture(scope="module")
def double_pendulum(data_folder: Path) -> tuple[Robot, list[Recording]]:
    folder = data_folder / "dfki_double_pendulum"
    robot = load_robot(
        folder / "C1_model.urdf", config=CHECKOUT / "examples" / "data" / "double_pendulum" / "robot.yaml"
    )
    with np.load(folder / "C1_sysid.npz") as runs:
        names = sorted({key.partition("__")[0] for key in runs})
        data = [[runs[f"{name}__{column}"] for column in ("t", "q", "tau_meas")] for name in names]
    return robot, [
        Recording(name, robot.joint_names, t, q[:, :2], tau[:, :2])
        for name, (t, q, tau) in zip(names, data, strict=True)
    ]


@pytest.mark.nightly
def test_a_double_pendulum_corrected_on_five_runs_lacks_nothing_for_certain_on_the_others(double_pendulum):
    robot, runs = double_pendulum
    assert claims(judged_beside(robot, tuple(runs[0::2]), tuple(runs[1::2]))) == []


@pytest.mark.nightly
def test_an_axis_corrected_on_the_second_half_of_its_recording_lacks_nothing_for_certain_in_the_first(data_folder):
    # Not the other way round: corrected on the first half, its second half shows a ripple of 2.5 mm and 1 N, which
    # least squares finds in both halves and both directions with the same phase.
    data = np.load(data_folder / "emps" / "emps_train.npz")
    half = len(data["t"]) // 2
    first, second = (
        Recording("emps", ("axis",), data["t"][part], data["q_meas"][part, None], data["force"][part, None])
        for part in (slice(0, half), slice(half, None))
    )
    assert claims(judged_beside(load_robot("emps"), (second,), (first,))) == []
