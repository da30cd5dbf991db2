from pathlib import Path

import pytest
import yaml

from by_night import by_night
from identification.diagnosis.columns.operations import with_known
from identification.diagnosis.columns.terms import KnownEffect
from identification.diagnosis.result import Diagnosis
from identification.export.corrected.corrected_yaml import known_effects, write_corrected
from identification.pipeline import diagnose
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.operation import Operation
from phantom_dyn.errors import ParameterError
from phantom_dyn.model.robot import Robot

pytestmark = pytest.mark.whole


def saved(diagnosis: Diagnosis, robot: Robot, folder: Path) -> Path:
    file = folder / "corrected.yaml"
    file.write_text(write_corrected(diagnosis, robot.source, robot.sha256))
    return file


def corrected(folder: Path, *effects: dict) -> Path:
    content = {
        "schema": "phantom-dyn-model/1",
        "robot": {"source": "arm.urdf", "sha256": "ab" * 32},
        "effects": [{"gap_closed": 0.5, **effect} for effect in effects],
        "adjusted": [],
    }
    file = folder / "corrected.yaml"
    file.write_text(yaml.safe_dump(content))
    return file


def value(number: float) -> dict:
    return {"value": number, "std": 0.01, "unit": "N m"}


COULOMB = {"effect": "coulomb_friction", "joint": "elbow", "parameters": {"torque": value(0.3)}}


def test_effects_of_a_file_come_in_the_order_of_the_contract(planar2, tmp_path):
    parameters = {"rest_position": value(0.2), "stiffness": value(3.0)}
    file = corrected(tmp_path, {"effect": "parasitic_spring", "joint": "elbow", "parameters": parameters}, COULOMB)
    assert known_effects((file,), planar2) == (
        KnownEffect("parasitic_spring", "elbow", (3.0, 0.2)),
        KnownEffect("coulomb_friction", "elbow", (0.3,)),
    )


def test_several_files_add_up(planar2, tmp_path):
    (tmp_path / "more").mkdir()
    files = (corrected(tmp_path, COULOMB), corrected(tmp_path / "more", {**COULOMB, "joint": "shoulder"}))
    assert [effect.joint for effect in known_effects(files, planar2)] == ["elbow", "shoulder"]


def test_inertial_parameters_that_are_not_named_did_not_move(planar2, tmp_path):
    name = effect_named("inertial_parameters").parameters(planar2, "elbow")[3].name
    entry = {"effect": "inertial_parameters", "joint": "elbow", "parameters": {name: value(0.1)}}
    assert known_effects((corrected(tmp_path, entry),), planar2)[0].theta == (0.0, 0.0, 0.0, 0.1, *[0.0] * 6)


@pytest.mark.parametrize("parameters", [{}, {"torque": value(0.3), "level": value(1.0)}], ids=["missing", "unknown"])
def test_parameters_that_are_not_those_of_the_effect_are_refused(planar2, tmp_path, parameters):
    file = corrected(tmp_path, {**COULOMB, "parameters": parameters})
    with pytest.raises(
        ParameterError, match=r"effect coulomb_friction has parameters .*wanted torque: correct the fil"
    ):
        known_effects((file,), planar2)


ROUND_TRIPS = (
    ("coulomb_friction", "elbow", (0.3,)),
    ("torque_constant", "shoulder", (0.7,)),
    ("payload", None, (0.6, 0.03, 0.0, -0.35)),
    ("parasitic_spring", "shoulder", (6.0, 0.2)),
    ("direction_dependent_friction", "elbow", (0.5, 0.3, 0.05, 0.35)),
    ("inertial_parameters", "elbow", (0.5, 0.02, 0.0, -0.2, 0.1, 0.0, 0.1, 0.0, 0.0, 0.01)),
)


@pytest.mark.parametrize(
    "effect", by_night([(one,) for one in ROUND_TRIPS], 0, 2), ids=[name for name, *_ in ROUND_TRIPS]
)
def test_what_a_diagnosis_found_is_no_gap_when_it_is_known(diagnosed, lacking, planar2, tmp_path, effect):
    # Known truth: the only gap is what the first diagnosis found.
    first = diagnosed(effect)
    assert first.findings
    known = known_effects((saved(first, planar2, tmp_path),), planar2)
    second = diagnose(planar2, (lacking(effect),), known=known)
    assert second.verdict == "no_gap"
    assert second.findings == ()


def test_a_load_is_all_that_is_left_of_a_loaded_robot_whose_friction_is_known(diagnosed, lacking, planar2, tmp_path):
    # Contract: diagnose the bare robot, then the loaded one with it, and only the load is left to find.
    friction, load = ROUND_TRIPS[0], ROUND_TRIPS[2]
    known = known_effects((saved(diagnosed(friction), planar2, tmp_path),), planar2)
    loaded = diagnose(planar2, (lacking(friction, load),), known=known)
    assert [(f.effect, f.joint) for f in loaded.findings] == [("payload", None)]
    assert loaded.findings[0].parameters["mass"].value == pytest.approx(0.6, rel=0.1)


@pytest.mark.nightly
def test_friction_under_load_is_that_of_the_load_that_is_left(lab, planar2):
    # Known truth: of 0.9 kg that an earlier diagnosis found, 0.6 are taken off, and the friction they made with them.
    center, rubs = (0.0, 0.0, -0.4), KnownEffect("load_dependent_friction", "shoulder", (0.3,))
    motion = lab.motion(2, 3, seconds=20.0, swing=1.5)
    true = with_known(planar2, Operation.of(planar2, motion), (KnownEffect("payload", None, (0.3, *center)), rubs))
    recording = lab.recording(planar2, motion, Operation.of(planar2, motion).tau - true.tau)
    found = diagnose(planar2, (recording,), known=(KnownEffect("payload", None, (0.9, *center)), rubs))
    # Free parameters of the last link are a payload with more numbers: either is the load.
    assert len(found.findings) == 1
    assert found.findings[0].effect in ("payload", "inertial_parameters")
    assert found.verdict == "explained"
