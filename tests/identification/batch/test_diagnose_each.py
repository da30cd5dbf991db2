"""Many recordings, each by itself. Oracles: a diagnosis of each alone, known truth, the csv and json libraries."""

import csv
import io
import json
from pathlib import Path

import numpy as np
import pytest

from identification.batch import diagnose_each as each
from identification.batch.batch_tables import csv_text, json_text, table, write_tables
from identification.batch.diagnose_each import (
    DiagnosedRecording,
    DiagnosedRecordings,
    diagnose_each,
    folder_names,
    logs_in,
)
from identification.data.reading import ReadOptions, read_recording
from identification.export.file_names import NAMES as MODELS
from identification.pipeline import diagnose
from identification.reporting.stored.diagnosis_files import INDEX, REPORT, to_json
from identification.words.stage_words import in_words
from phantom_dyn.errors import LogError, ParameterError, UsageError
from phantom_dyn.large_work import WorkerLostError


@pytest.fixture(scope="module")
def folder(tmp_path_factory, lab, pendulum) -> Path:
    """Two recordings of the pendulum, one of them with friction, one that is no log and one of another robot."""
    folder = tmp_path_factory.mktemp("recordings")
    for seed, friction in enumerate((0.0, 0.5)):
        motion = lab.motion(1, seed, seconds=6.0)
        made = lab.recording(pendulum, motion, -friction * np.sign(motion.v), noise=0.01)
        rows = np.column_stack([made.t, made.q, made.tau])
        np.savetxt(folder / f"run{seed}.csv", rows, "%.17g", ",", header="t,q.pin,tau.pin", comments="")
    (folder / "text.csv").write_text("t,q.pin,tau.pin\n0,left,1\n")
    (folder / "other.csv").write_text("t,q.elbow,tau.elbow\n0,0,1\n1,0,1\n")
    return folder


@pytest.fixture(scope="module")
def logs(folder) -> list[Path]:
    return [folder / name for name in ("run1.csv", "text.csv", "run0.csv", "other.csv")]


@pytest.fixture(scope="module")
def found(pendulum, logs) -> DiagnosedRecordings:
    return diagnose_each(pendulum, logs, jobs=1)


@pytest.fixture
def rows() -> DiagnosedRecordings:
    """A table that was not computed."""
    document = {
        "findings": [
            {"effect": "coulomb_friction", "joint": "j1", "parameters": {}},
            {"effect": "payload", "joint": None, "parameters": {}},
        ],
        "unexplained": {"fraction_of_explainable": 0.25},
        "joints": [{"joint": "j2", "rms_before": 2.0, "rms_after": 1.0}],
        "seconds": 3.5,
        "run": "0123",
    }
    causes = tuple(f"friction on joint j{k}" for k in range(5))
    return DiagnosedRecordings(
        "arm",
        ("j1", "j2"),
        (
            DiagnosedRecording("logs/a.csv", "a", "partly_explained", causes, document),
            DiagnosedRecording("logs/b\n.csv", "b", "refused", refusal='b.csv: no "t", record it again.'),
        ),
    )


@pytest.mark.whole
def test_every_recording_has_the_diagnosis_that_it_has_alone(found, pendulum, logs):
    for k in (0, 2):
        alone = to_json(diagnose(pendulum, (read_recording(logs[k], pendulum),)))
        own = {"seconds": 0, "run": ""}
        assert found.rows[k].document | own == alone | own


def test_rows_stand_in_the_order_of_the_logs(found, logs):
    assert [row.log for row in found.rows] == [str(log) for log in logs]


def test_a_recording_that_is_refused_does_not_stop_the_others(found):
    # Known truth: friction was added to run1.
    assert [row.verdict for row in found.rows] == ["explained", "refused", "no_gap", "refused"]
    assert found.rows[0].causes == ("Coulomb friction on joint pin",)


def test_a_refusal_is_the_sentence_of_the_diagnosis_alone(found, pendulum, logs):
    for k in (1, 3):
        with pytest.raises(LogError) as alone:
            read_recording(logs[k], pendulum)
        assert found.rows[k].refusal == str(alone.value)


def test_the_refused_are_known(found):
    assert [Path(row.log).name for row in found.refused] == ["text.csv", "other.csv"]


def test_a_fault_of_the_diagnosis_is_a_row_as_well(pendulum, logs, monkeypatch):
    def fails(*_: object, **__: object) -> None:
        raise np.linalg.LinAlgError("SVD did not\nconverge")

    monkeypatch.setattr(each, "diagnose", fails)
    (row,) = diagnose_each(pendulum, logs[:1], jobs=1).rows
    said = "run1.csv: the diagnosis itself failed (LinAlgError: SVD did not converge): please report this with the"
    assert (row.verdict, row.refusal and row.refusal.startswith(said)) == ("refused", True)


def test_a_recording_whose_process_is_lost_is_a_row_as_well(pendulum, logs, monkeypatch):
    def lost(*_: object, **__: object):
        yield 1, DiagnosedRecording("text.csv", "text", "no_gap")
        raise WorkerLostError((0,))

    monkeypatch.setattr(each, "spread", lost)
    result = diagnose_each(pendulum, logs[:2])
    assert [row.verdict for row in result.rows] == ["refused", "no_gap"]
    assert "run1.csv: the process that diagnosed it ended again and again" in str(result.rows[0].refusal)


def test_progress_counts_the_recordings(pendulum, logs):
    sentence: list[str] = []
    diagnose_each(pendulum, logs[1::2], jobs=1, progress=in_words(sentence.append))
    begun = "diagnosed 0 of 2 recordings"
    assert sentence == [begun, "diagnosed 1 of 2, last text.csv", "diagnosed 2 of 2, last other.csv"]


def test_each_recording_gets_its_folder_and_a_refused_one_none(pendulum, logs, tmp_path):
    diagnose_each(pendulum, logs[1:3], out=tmp_path / "out", jobs=1)
    written = sorted(str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*.*"))
    assert written == sorted(f"out/run0/{name}" for name in (INDEX, REPORT, *MODELS))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ([], r"\[\] was given, wanted a list of at least one recording"),
        ("run0.csv", "'run0.csv' was given, wanted a list of at least one recording"),
        (["run0.csv", "run7.csv"], r"run7\.csv does not exist; did you mean run1\.csv\?"),
        (["run0.csv", "./run1.csv", "../{}/run0.csv"], r"run0\.csv is given twice: give every recording once"),
    ],
)
def test_recordings_that_cannot_be_meant(pendulum, folder, monkeypatch, given, message):
    monkeypatch.chdir(folder)
    words = given if isinstance(given, str) else [word.format(folder.name) for word in given]
    with pytest.raises(LogError, match=message):
        diagnose_each(pendulum, words)


def test_a_column_map_that_cannot_be_used_is_refused_before_the_work(pendulum, logs, tmp_path):
    (tmp_path / "map.yaml").write_text("torque: tau.pin")
    with pytest.raises(LogError, match=r"map\.yaml: torque is no column of a log"):
        diagnose_each(pendulum, logs, reading=ReadOptions(tmp_path / "map.yaml"))


def test_a_folder_that_cannot_be_written_is_refused_before_the_work(pendulum, logs, tmp_path):
    (tmp_path / "run1").write_text("")
    with pytest.raises(UsageError, match=r"--out .*run1 is a file, wanted a folder"):
        diagnose_each(pendulum, logs, out=tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["run1"]


def test_no_processes_are_refused(pendulum, logs):
    with pytest.raises(ParameterError, match="jobs = 0 was given"):
        diagnose_each(pendulum, logs, jobs=0)


@pytest.mark.parametrize(
    ("paths", "names"),
    [
        (["/d/a.csv", "/d/b.2.csv"], ("a", "b.2")),
        (["/d/a.csv", "/d/a.npz", "/d/b.csv"], ("a.csv", "a.npz", "b")),
        (["/mon/a.csv", "/tue/a.csv"], ("mon_a.csv", "tue_a.csv")),
        (["/d/A.csv", "/e/a.csv"], ("d_A.csv", "e_a.csv")),
        (["/x/1/a.csv", "/y/1/a.csv", "/y/a.csv"], ("x_1_a.csv", "y_1_a.csv", "y_a.csv")),
        (["/d/diagnoses.csv.npz"], ("diagnoses.csv.npz",)),
        (["/a_b/c.csv", "/a/b_c.csv"], ("c", "b_c")),
        (["/a/b/c", "/a_b/c", "/x/b/c"], ("a_b_c_1", "a_b_c_2", "x_b_c")),
    ],
)
def test_folders_are_named_after_their_logs_and_differ(paths, names):
    # Known truth: written out by hand.
    assert folder_names([Path(path) for path in paths]) == names


def test_the_logs_of_a_folder_are_its_recordings_by_name(tmp_path):
    for name in ("b.csv", "a.MCAP", "diagnoses.csv", ".hidden.csv", "notes.txt", "bag/metadata.yaml", "old/c.csv"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    assert [Path(log).name for log in logs_in(str(tmp_path))] == ["a.MCAP", "b.csv", "bag"]


def test_a_folder_of_folders_is_a_fleet(tmp_path):
    for name in ("two/b.csv", "one/c.csv", "one/a.csv", "notes.txt", ".git/d.csv"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    assert [Path(log).relative_to(tmp_path).as_posix() for log in logs_in(str(tmp_path))] == [
        "one/a.csv", "one/c.csv", "two/b.csv",
    ]  # fmt: skip


def test_a_file_and_a_bag_stand_for_themselves(tmp_path):
    (tmp_path / "metadata.yaml").touch()
    assert logs_in(str(tmp_path)) == [str(tmp_path)]
    assert logs_in("any.file") == ["any.file"]


def test_a_folder_without_recordings_is_refused(tmp_path):
    with pytest.raises(LogError, match=r"holds no recording: wanted files that end in \.csv, .*or ROS 2 bags; name"):
        logs_in(str(tmp_path))


def test_the_table_for_a_terminal(rows):
    # Known truth: written out by hand.
    assert table(rows).splitlines() == [
        "recording  verdict           cause",
        "a.csv      partly_explained  friction on joint j0, friction on joint j1, friction on joint j2 and 2",
        "                             more",
        'b .csv     refused           b.csv: no "t", record it again.',
        "",
        "2 recordings: 1 partly_explained, 1 refused",
    ]


def test_the_table_as_csv_is_read_back(rows):
    # Oracle: Python's csv.
    first, second = csv.DictReader(io.StringIO(csv_text(rows)))
    assert first == {
        "log": "logs/a.csv",
        "folder": "a",
        "verdict": "partly_explained",
        "findings": "coulomb_friction j1; payload",
        "unexplained": "0.25",
        "rms_before.j1": "",
        "rms_after.j1": "",
        "rms_before.j2": "2.0",
        "rms_after.j2": "1.0",
        "seconds": "3.5",
        "refusal": "",
        "run": "0123",
    }
    assert (second["log"], second["refusal"]) == ("logs/b\n.csv", 'b.csv: no "t", record it again.')


def test_the_table_as_json_holds_every_document(rows):
    # Oracle: Python's json.
    content = json.loads(json_text(rows))
    assert (content["schema"], content["robot"]) == ("gap-diagnoses/1", "arm")
    assert [row["diagnosis"] for row in content["recordings"]] == [rows.rows[0].document, None]
    assert [row["verdict"] for row in content["recordings"]] == ["partly_explained", "refused"]


def test_tables_are_written_beside_the_folders(rows, tmp_path):
    written = write_tables(rows, out=tmp_path, json_file=tmp_path / "one.json")
    assert [path.name for path in written] == ["diagnoses.json", "diagnoses.csv", "fleet.html", "one.json"]
    assert written[0].read_text() == written[3].read_text() == json_text(rows)
    assert written[1].read_text() == csv_text(rows)
