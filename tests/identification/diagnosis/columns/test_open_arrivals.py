"""Servos whose voltage is read once a frame. Oracle: known truth of a simulation that shares no code with ours."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.servo_cases import case
from identification.data.reading import read_recording
from identification.diagnosis.columns.nuisances import moves_of
from identification.diagnosis.columns.operations import moved_robot
from identification.diagnosis.columns.session import session_of
from identification.notes import Code, Note
from identification.pipeline import diagnose
from identification.reporting.stored.diagnosis_files import write_outputs
from phantom_dyn.model.loading import load_robot

pytestmark = pytest.mark.whole


@pytest.fixture(scope="module")
def loaded(tmp_path_factory):
    """Case, robot and recording of a servo with a load, and its diagnosis."""
    one = case("load measured", 402)
    urdf, config, log = one.write(tmp_path_factory.mktemp("servo"))
    robot = load_robot(urdf, config=config)
    recording = read_recording(log, robot)
    return one, robot, recording, diagnose(robot, (recording,))


def test_a_load_is_found_alone(loaded):
    # The line through the readings alone makes viscous friction of 0.11 N m s/rad of it, and half of the load.
    one, _, _, found = loaded
    assert [finding.effect for finding in found.findings] == ["payload"]
    assert found.findings[0].parameters["mass"].value == pytest.approx(one.truth["payload"], rel=0.05)


def test_the_corrected_model_follows_the_motion(loaded):
    *_, found = loaded
    assert found.rollout["rms_after"]["j0"] < 0.01 * found.rollout["rms_before"]["j0"]


def test_that_friction_looks_the_same_is_said(loaded):
    *_, found = loaded
    assert Code.OPEN_ARRIVAL in {note.code for note in found.notes if isinstance(note, Note)}


def test_files_say_that_the_readings_are_no_mean(loaded, tmp_path: Path):
    _, robot, _, found = loaded
    write_outputs(found, robot, out=tmp_path, json_file=None)
    assert "was read once while each reference was held" in (tmp_path / "corrected.yaml").read_text(encoding="utf-8")


def test_when_references_arrive_changes_no_model(loaded):
    _, robot, recording, _ = loaded
    session = session_of(robot, (recording,))
    values = np.array([0.4 if move.kind == "arrival" else 0.0 for move in moves_of(session.robot)])
    moved = moved_robot(session.robot, values)
    assert values.any()
    assert moved.viscous_friction.tolist() == session.robot.viscous_friction.tolist()
    assert moved.rotor_inertia.tolist() == session.robot.rotor_inertia.tolist()


def test_a_perfect_servo_has_no_friction(tmp_path: Path):
    urdf, config, log = case("null measured", 401).write(tmp_path)
    robot = load_robot(urdf, config=config)
    assert diagnose(robot, (read_recording(log, robot),)).findings == ()
