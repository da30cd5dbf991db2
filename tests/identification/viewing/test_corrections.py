"""What a diagnosis adds to a model. Oracle: the diagnosis that was written."""

from __future__ import annotations

from dataclasses import replace

import pytest

from identification.diagnosis.columns.terms import KnownEffect
from identification.export.corrected.corrected_yaml import write_corrected
from identification.reporting.stored.diagnosis_files import json_text
from identification.viewing.corrections import read_correction
from phantom_dyn.errors import LogError, UsageError

FOUND = (
    KnownEffect("coulomb_friction", "shoulder", (0.251,)),
    KnownEffect("viscous_friction", "elbow", (0.13,)),
)


@pytest.fixture
def diagnosis(made_up):
    return made_up(("shoulder", "elbow"), findings=2, samples=100)


@pytest.fixture
def folder(tmp_path, diagnosis):
    (tmp_path / "diagnosis.json").write_text(json_text(diagnosis))
    (tmp_path / "corrected.yaml").write_text(write_corrected(diagnosis, "planar2.urdf", "abc"))
    return tmp_path


@pytest.mark.parametrize("name", ["diagnosis.json", ".", "corrected.yaml"])
def test_every_file_of_a_diagnosis_holds_its_findings_and_moves(folder, planar2, diagnosis, name):
    found = read_correction(folder / name, planar2)
    assert found.effects == FOUND
    assert [(one.quantity, one.change) for one in found.adjusted] == [("link2 mass", 0.02)]


def test_the_horizon_is_that_of_the_rollout(tmp_path, planar2, diagnosis):
    rollout = {"horizon_s": 0.35, "rms_before": {}, "rms_after": {}}
    (tmp_path / "diagnosis.json").write_text(json_text(replace(diagnosis, rollout=rollout)))
    assert read_correction(tmp_path, planar2).horizon_s == 0.35


def test_what_acts_in_one_recording_only_is_no_part_of_the_robot(tmp_path, planar2, diagnosis):
    first, second = diagnosis.findings
    there = replace(diagnosis, findings=(replace(first, recording="b.csv"), second))
    (tmp_path / "diagnosis.json").write_text(json_text(there))
    assert read_correction(tmp_path, planar2).effects == FOUND[1:]


def test_the_diagnosis_of_another_robot_is_refused(tmp_path, planar2, made_up):
    (tmp_path / "diagnosis.json").write_text(json_text(made_up(("j1", "j2"))))
    with pytest.raises(UsageError, match=r"robot with the joints j1, j2, and planar2 has shoulder, elbow: give the"):
        read_correction(tmp_path, planar2)


def test_a_file_that_is_not_there_is_refused(tmp_path, planar2):
    with pytest.raises(LogError, match=r"none\.json cannot be read"):
        read_correction(tmp_path / "none.json", planar2)
