"""Stored diagnoses: files and schema."""

import dataclasses
import json
import math
from collections.abc import Callable
from typing import Any

import pytest

from identification.diagnosis.result import Diagnosis, Value
from identification.export.corrected.corrected_yaml import read_corrected
from identification.export.file_names import NAMES as MODELS
from identification.reporting.stored.diagnosis_files import check_targets, json_text, write_outputs
from identification.reporting.stored.diagnosis_reader import read_diagnosis
from phantom_dyn.errors import LogError, ParameterError, UsageError
from phantom_dyn.model.loading import load_robot
from places import ROBOTS

ROBOT = load_robot(ROBOTS / "planar2.urdf")


def diagnosis(made_up) -> Diagnosis:
    return made_up(ROBOT.joint_names, samples=400)


def test_a_folder_gets_all_files(made_up, tmp_path):
    out = tmp_path / "new" / "report"
    written = write_outputs(diagnosis(made_up), ROBOT, out=out, json_file=None)
    assert [path.name for path in written] == ["diagnosis.json", "report.html", *MODELS]
    assert sorted(path.name for path in out.iterdir()) == sorted(path.name for path in written)
    assert read_corrected(out / "corrected.yaml").sha256 == ROBOT.sha256


def test_the_json_can_go_to_another_place(made_up, tmp_path):
    written = write_outputs(diagnosis(made_up), ROBOT, out=None, json_file=tmp_path / "a.json")
    assert written == (tmp_path / "a.json",)
    assert json.loads(written[0].read_text())["schema"] == "gap-diagnosis/3"


def test_without_a_target_nothing_is_written(made_up):
    assert write_outputs(diagnosis(made_up), ROBOT, out=None, json_file=None) == ()


def test_files_of_others_stay_and_ours_are_replaced(made_up, tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    (tmp_path / "diagnosis.json").write_text('{"schema": "gap-diagnosis/2"}')
    write_outputs(diagnosis(made_up), ROBOT, out=tmp_path, json_file=None)
    assert (tmp_path / "mine.txt").read_text() == "mine"
    assert (tmp_path / "diagnosis.json").read_text().startswith('{\n "schema": "gap-diagnosis/3"')


def test_a_file_as_folder_is_refused(made_up, tmp_path):
    (tmp_path / "report").write_text("")
    with pytest.raises(UsageError, match=r"--out .*report is a file, wanted a folder; name another folder"):
        write_outputs(diagnosis(made_up), ROBOT, out=tmp_path / "report", json_file=None)


def test_nothing_is_written_when_one_target_cannot_be(made_up, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match=r"--json: cannot write .*a\.json: .*file is no folder; name a file"):
        write_outputs(diagnosis(made_up), ROBOT, out=tmp_path / "out", json_file=tmp_path / "file" / "a.json")
    assert not (tmp_path / "out").exists()


def test_a_folder_in_the_place_of_a_file_is_refused(made_up, tmp_path):
    (tmp_path / "report.html").mkdir()
    with pytest.raises(UsageError, match=r"--out: .*report\.html is a folder, wanted a file"):
        write_outputs(diagnosis(made_up), ROBOT, out=tmp_path, json_file=None)
    assert [path.name for path in tmp_path.iterdir()] == ["report.html"]


def test_a_folder_without_the_right_to_write_is_refused(made_up, tmp_path, monkeypatch):
    monkeypatch.setattr("os.access", lambda *_: False)  # the superuser may write anywhere
    with pytest.raises(UsageError, match=r"no right to write in .*; name another place"):
        write_outputs(diagnosis(made_up), ROBOT, out=tmp_path, json_file=None)


def test_a_parameter_without_a_value_leaves_no_file(made_up, tmp_path):
    bad = dataclasses.replace(made_up().findings[0], parameters={"torque": Value(math.nan, 0.1, "N m")})
    with pytest.raises(ParameterError, match="torque of coulomb_friction is nan, wanted a finite number"):
        write_outputs(
            dataclasses.replace(diagnosis(made_up), findings=(bad,)), ROBOT, out=tmp_path / "out", json_file=None
        )
    assert not (tmp_path / "out").exists()


def test_the_report_shows_the_robot(made_up, tmp_path):
    write_outputs(diagnosis(made_up), ROBOT, out=tmp_path, json_file=None)
    assert 'id="robot-figure"' in (tmp_path / "report.html").read_text()


def test_what_the_files_cannot_say_is_in_the_report(made_up, tmp_path):
    write_outputs(diagnosis(made_up), ROBOT, out=tmp_path, json_file=None)
    page = (tmp_path / "report.html").read_text()
    assert "corrected.xml: loaded again with MuJoCo" in page
    assert "corrected.xml: it lacks limits of torque and speed of the given file" in page


RUN = "0123456789abcdef0123456789abcdef"


@pytest.mark.parametrize("name", ["corrected.urdf", "report.html", "next.csv", "residual.py", "diagnosis.json"])
def test_a_file_of_the_user_is_neither_written_over_nor_removed(made_up, tmp_path, name):
    (tmp_path / name).write_text("made by hand")
    with pytest.raises(UsageError, match=rf"/{name} was not written by phantom-dyn, .*: name another folder"):
        check_targets(tmp_path, None)
    with pytest.raises(UsageError, match=rf"/{name} was not written"):
        write_outputs(diagnosis(made_up), ROBOT, out=tmp_path, json_file=None)
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [(name, "made by hand")]


def test_all_files_of_an_earlier_run_are_written_over(made_up, tmp_path):
    found = dataclasses.replace(diagnosis(made_up), run=RUN)
    first = write_outputs(found, ROBOT, out=tmp_path, json_file=None)
    (tmp_path / "next.csv").write_text("t,q_ref.pin\n")  # it has no place for a mark, and goes with the index
    (tmp_path / "feedforward.py").write_text("")
    (tmp_path / "notes.txt").write_text("made by hand")
    other = dataclasses.replace(found, run=RUN[::-1])
    assert write_outputs(other, ROBOT, out=tmp_path, json_file=None) == first
    assert RUN[::-1] in (tmp_path / "feedforward.py").read_text()
    assert (tmp_path / "notes.txt").read_text() == "made by hand"


def test_a_model_of_an_earlier_run_that_cannot_be_written_is_removed(made_up, tmp_path):
    (tmp_path / "corrected.xml").write_text(f"<mujoco/>\n<!-- run: {RUN} -->\n")
    heavy = dataclasses.replace(
        made_up().findings[0],
        effect="payload",
        joint=None,
        parameters={name: Value(-9.0, 0.1, "kg") for name in ("mass", "center_x", "center_y", "center_z")},
    )
    found = dataclasses.replace(diagnosis(made_up), findings=(heavy,))
    written = write_outputs(found, ROBOT, out=tmp_path, json_file=None)
    assert [path.name for path in written] == ["diagnosis.json", "report.html", "corrected.yaml"]
    assert not (tmp_path / "corrected.xml").exists()
    assert "would weigh" in (tmp_path / "report.html").read_text()


def test_every_file_carries_the_run(made_up, tmp_path):
    # Oracle: the run that diagnosis.json states.
    found = dataclasses.replace(diagnosis(made_up), run=RUN)
    for path in write_outputs(found, ROBOT, out=tmp_path / "out", json_file=None):
        assert found.run in path.read_text(), path.name


@pytest.fixture
def refused(made_up, tmp_path) -> Callable[..., str]:
    """Reads a good file after a change, which must be refused in one sentence."""

    def read(change: Callable[[dict[str, Any]], object]) -> str:
        content = json.loads(json_text(made_up()))
        path = tmp_path / "diagnosis.json"
        path.write_text(json.dumps(content))
        assert read_diagnosis(path).verdict == content["verdict"]
        change(content)
        path.write_text(json.dumps(content))
        with pytest.raises(LogError) as refusal:
            read_diagnosis(path)
        assert str(refusal.value).startswith(str(path))
        assert str(refusal.value).endswith("diagnose the recording again.")
        return str(refusal.value)

    return read


@pytest.mark.parametrize(
    ("part", "key", "value", "said"),
    [
        ("findings", "joint", ["j1"], "$.findings[0].joint"),
        ("findings", "gap_closed", 10**400, "gap_closed"),
        ("findings", "gap_closed", 1e300, "gap_closed"),  # its square is no float
        ("ledger", "outcome", "perhaps", "$.ledger[0].outcome"),
    ],
)
def test_what_no_diagnosis_holds_is_refused_with_its_place(refused, part, key, value, said):
    assert said in refused(lambda content: content[part][0].update({key: value}))


def test_an_unknown_key(refused):
    assert "more" in refused(lambda content: content.update(more=1))


def test_a_text_for_a_number(refused):
    said = refused(lambda content: content["joints"][0].update(rms_before="much"))
    assert "Expected float" in said
    assert "$.joints[0].rms_before" in said


def test_a_file_without_a_ledger_is_read(made_up, tmp_path):
    content = json.loads(json_text(made_up()))
    del content["ledger"]
    path = tmp_path / "diagnosis.json"
    path.write_text(json.dumps(content))
    assert read_diagnosis(path).ledger == ()


def test_fewer_deviations_than_values(refused):
    def change(content: dict[str, Any]) -> None:
        value = next(iter(content["findings"][0]["parameters"].values()))
        value.update(value=[1.0, 2.0], std=[0.1])

    assert "has not as many standard deviations as values" in refused(change)


def test_lists_in_one_another_without_end(tmp_path):
    path = tmp_path / "diagnosis.json"
    path.write_text("[" * 100_000)
    with pytest.raises(LogError, match=r"is no JSON .*: give a diagnosis\.json"):
        read_diagnosis(path)
