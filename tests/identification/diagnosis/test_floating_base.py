"""Robots that are not bolted down. Oracle: known truth, on torques that Pinocchio computes for a free-flyer."""

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

from by_night import by_night
from floating_leg import log_of_leg, with_sensor_errors, written_leg
from identification.data.floating.base_errors import SENSOR_ERRORS
from identification.data.reading import recording
from identification.data.recording import Table
from identification.diagnosis.result import Diagnosis
from identification.export.all_files import export_texts
from identification.identify.identify import identify
from identification.pipeline import diagnose
from identification.words.note_words import sentences
from phantom_dyn.errors import LogError, ParameterError
from phantom_dyn.model.loading import load_robot


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory) -> Callable[..., Diagnosis]:
    """Diagnosis of the leg that hangs or steps, and may rub, made once of each."""
    file = written_leg(tmp_path_factory.mktemp("leg"))
    robot = load_robot(file)

    @cache
    def run(*, steps: bool, dry: float) -> Diagnosis:
        columns = log_of_leg(file, np.random.default_rng(1), steps=steps, dry=dry, seconds=14.0)
        return diagnose(robot, (recording(Table("log.csv", columns), robot),))

    return run


@pytest.mark.whole
@pytest.mark.parametrize("steps", [False, True])
def test_a_leg_as_modelled_has_no_gap_whatever_its_foot_stands_on(diagnosed, steps):
    assert diagnosed(steps=steps, dry=0.0).verdict == "no_gap"


def with_errors(folder, rng, **options):
    file = written_leg(folder)
    robot = load_robot(file)
    columns = with_sensor_errors(log_of_leg(file, rng, seconds=14.0, **options))
    return diagnose(robot, (recording(Table("log.csv", columns), robot),))


@pytest.mark.whole
def test_ordinary_errors_of_the_bases_sensors_are_no_gap(tmp_path, rng):
    assert with_errors(tmp_path, rng).verdict == "no_gap"


@pytest.mark.whole
@pytest.mark.nightly
def test_a_model_that_trusts_the_bases_sensors_is_accused(tmp_path, rng, monkeypatch):
    for name in tuple(SENSOR_ERRORS):
        monkeypatch.delitem(SENSOR_ERRORS, name)
    assert with_errors(tmp_path, rng).verdict != "no_gap"


@pytest.mark.whole
def test_friction_is_found_beside_ordinary_errors_of_the_bases_sensors(tmp_path, rng):
    found = with_errors(tmp_path, rng, dry=0.3)
    assert [(one.effect, one.joint) for one in found.findings] == [("coulomb_friction", "knee")]
    assert found.findings[0].parameters["torque"].value == pytest.approx(0.3, abs=0.03)


@pytest.mark.whole
@pytest.mark.parametrize("steps", by_night([False, True], 0))
def test_friction_of_the_knee_is_found_in_the_air(diagnosed, steps):
    found = diagnosed(steps=steps, dry=0.3)
    assert [(one.effect, one.joint) for one in found.findings] == [("coulomb_friction", "knee")]
    torque = found.findings[0].parameters["torque"]
    assert torque.value == pytest.approx(0.3, abs=0.03)
    assert found.rollout["rms_after"]["knee"] < 0.1 * found.rollout["rms_before"]["knee"]


@pytest.mark.whole
def test_no_feedforward_is_written_as_nobody_knows_how_the_base_will_move(diagnosed, tmp_path):
    found = diagnosed(steps=False, dry=0.3)
    texts, said = export_texts(found, load_robot(written_leg(tmp_path)), folder=tmp_path)
    assert {"corrected.urdf", "corrected.xml", "corrected.yaml", "isaac_lab.py"} <= set(texts)
    assert not {"feedforward.py", "feedforward.csv"} & set(texts)
    assert any(
        one.startswith("feedforward.py and feedforward.csv were not written: the torque of another motion depends")
        for one in sentences(said.notes)
    )


@pytest.mark.whole
def test_the_base_moves_in_the_files_proof_as_in_the_recording(diagnosed):
    replay = diagnosed(steps=False, dry=0.3).replay
    (log,) = replay.logs
    np.testing.assert_array_equal(replay.base.columns, log.motion.base.columns[log.samples])


@pytest.mark.whole
def test_no_sample_counts_whose_filter_reaches_a_contact(diagnosed):
    hanging, stepping = (diagnosed(steps=steps, dry=0.0).joints[0].hold_out_samples for steps in (False, True))
    assert 0 < stepping < 0.5 * hanging


def test_a_leg_that_always_stands_is_refused(tmp_path, rng):
    file = written_leg(tmp_path)
    robot = load_robot(file)
    columns = log_of_leg(file, rng)
    columns["contact.foot"] = np.ones_like(columns["t"])
    with pytest.raises(LogError, match=r"log\.csv: no joint is free of contacts for [\d.]+ s, which the filter needs"):
        diagnose(robot, (recording(Table("log.csv", columns), robot),))


def test_identify_refuses_it(tmp_path, rng):
    file = written_leg(tmp_path)
    robot = load_robot(file)
    log = recording(Table("log.csv", log_of_leg(file, rng)), robot)
    with pytest.raises(ParameterError, match=r"leg is not bolted down \(base: floating\), and identify takes robots"):
        identify(robot, (log,))
