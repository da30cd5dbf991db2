"""Options and robots that are wrong end in one sentence."""

import json
import re

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from identification.cli.main import main
from places import ROBOTS


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--exclude", "2"), r"--exclude 2 was given, wanted two times in seconds such as 2\.5:4"),
        (("--exclude", "a:b"), r"--exclude a:b was given, wanted two times in seconds"),
        (("--exclude", "1:2:3"), r"--exclude 1:2:3 was given, wanted two times in seconds"),
        (("--exclude", "nan:2"), r"--exclude nan:2 was given, wanted two times in seconds"),
        (("--exclude", "4:2"), r"--exclude 4:2 ends before it begins, wanted T0 < T1"),
        (
            ("--exclude", "20:30"),
            r"the excluded stretch 20:30 lies outside log\.csv, which goes from 0 s to 9\.995 s: give times",
        ),
        (
            ("--exclude", "0:1e9"),
            r"the excluded stretches leave 0 of the 2000 rows of log\.csv, too few to tell anything: leave out less",
        ),
        (("--exclude", "0:9.8"), r"the excluded stretches leave 39 of the 2000 rows of log\.csv"),
        (("--exclude", "-3:-2"), r"the excluded stretch -3:-2 lies outside log\.csv"),
        (("--jobs", "0"), r"--jobs 0 was given, wanted a number of processes from 1 on"),
        (("--jobs", "two"), r"argument --jobs: invalid int value: 'two'; see phantom-dyn diagnose --help"),
        (("--no-such-option",), r"unrecognized arguments: --no-such-option; see phantom-dyn diagnose --help"),
        (
            ("--json", ""),
            r"word 5 of the command is empty, perhaps a variable of the shell that is not set: give a value",
        ),
        (("--columns",), r"argument --columns: expected one argument"),
        (("--hold-out",), r"argument --hold-out: expected at least one argument"),
        (("--hold-out", "{folder}/../{name}/log.csv"), r"given twice, as LOG and as --hold-out"),
        (("--json", "{folder}"), r"--json: .* is a folder, wanted a file; .*name another place"),
        (("--robot-config", "{folder}/no.yaml"), r"no\.yaml cannot be read \(No such file"),
    ],
)
def test_an_option_that_makes_no_sense(pendulum, log, refusal, words, message):
    given = [word.format(folder=log.parent, name=log.parent.name) for word in words]
    assert re.search(message, refusal(pendulum, log, *given))


def test_no_log(pendulum, refusal):
    assert re.search(r"the following arguments are required: LOG; see phantom-dyn diagnose --help", refusal(pendulum))


@pytest.mark.parametrize(
    ("option", "name", "message"),
    [
        ("--json", "log.csv", r"log\.csv is read, and would be written over: name another place"),
        ("--json", "other.csv", r"other\.csv ends as a recording or a robot does, .* name a file that ends in \.json"),
        ("--json", "robot.xml", r"robot\.xml ends as a recording or a robot does"),
        ("--out", ".", r"corrected\.urdf is read, and would be written over: name another place for what is written"),
    ],
)
def test_what_is_read_is_not_written_over(pendulum, log, capsys, option, name, message):
    # As in `diagnose robot.urdf --json first.csv second.csv`, and in a second round beside what the first has written.
    robot = log.parent / "corrected.urdf"
    robot.write_bytes(pendulum.read_bytes())
    (log.parent / "other.csv").write_bytes(log.read_bytes())
    before = {path.name: path.read_bytes() for path in log.parent.iterdir()}
    assert main(["diagnose", str(robot), str(log), option, str(log.parent / name)]) == 2
    assert re.search(message, capsys.readouterr().err)
    assert {path.name: path.read_bytes() for path in log.parent.iterdir()} == before


@pytest.mark.parametrize(
    "words",
    [
        ("diagnose", "{log}", "{robot}"),
        ("identify", "{log}", "{robot}", "--out", "o"),
        ("check", "{log}", "{robot}"),
        ("view", "{log}", "{robot}"),
        ("degrade", "{log}", "{robot}", "--effect", "cogging", "--out", "o.csv"),
    ],
    ids=lambda words: words[0],
)
def test_robot_and_log_that_were_swapped_are_recognised(pendulum, log, capsys, words):
    given = [word.format(log=log, robot=pendulum) for word in words]
    assert main(given) == 2
    said = capsys.readouterr().err
    assert said == (
        f"phantom-dyn: {log} is a recording and {pendulum} a robot: give the robot first, as in {pendulum} {log}\n"
    )


@pytest.mark.parametrize(
    ("words", "name", "reason"),
    [
        ("diagnose {robot} {log} --json {file}", "mine.json", "was not written by phantom-dyn"),
        ("compare {log} {log} --out {file}", "mine.html", "was not written by phantom-dyn"),
        ("map {robot} --quantity apparent_mass --grid x=0:0:1 --out {folder}", "map.npz", "was not written"),
        ("map {robot} --quantity apparent_mass --grid x=0:0:1 --out {folder}", "apparent_mass.png", "was not written"),
        ("experiment friction {robot} {log} --out {folder}", "experiment.json", "was not written by phantom-dyn"),
        ("experiment friction {robot} {log} --out {folder}", "friction.png", "was not written by phantom-dyn"),
        ("excite {robot} --out {file}", "ref.csv", "exists, and may be a recording of yours"),
        ("degrade {robot} {log} --effect cogging --out {file}", "cheap.npz", "exists, and may be a recording of yours"),
    ],
)
def test_no_command_writes_over_a_file_of_the_user(pendulum, log, capsys, tmp_path, words, name, reason):
    folder = tmp_path / "out"
    folder.mkdir()
    (folder / name).write_text("made by hand")
    places = {"robot": pendulum, "log": log, "folder": folder, "file": folder / name}
    assert main([word.format(**places) for word in words.split()]) == 2
    said = capsys.readouterr().err
    assert f"{folder / name} {reason}" in said
    assert said.count("\n") == 1
    assert (folder / name).read_text() == "made by hand"


def test_a_log_in_the_place_of_the_robot_says_that_the_robot_goes_first(log, capsys):
    assert main(["diagnose", str(log), str(log)]) == 2
    assert "was given as the robot and looks like a recording: give the robot first" in capsys.readouterr().err


@pytest.mark.parametrize(
    "words",
    [
        ("excite", "{robot}", "--out", "{log}/ref.csv"),
        ("degrade", "{robot}", "{log}", "--effect", "cogging", "--out", "{log}/cheap.csv"),
        ("map", "{robot}", "--quantity", "manipulability", "--grid", "q.pin=0:1:2", "--out", "{log}/maps"),
        ("identify", "{robot}", "{log}", "--out", "{log}/fitted"),
    ],
    ids=lambda words: words[0],
)
def test_a_place_that_cannot_be_written_is_refused_before_the_robot_is_loaded(
    pendulum, log, capsys, monkeypatch, words
):
    def loaded(*_, **__):
        raise AssertionError("the robot was loaded")

    monkeypatch.setattr("phantom_dyn.model.loading.load_robot", loaded)
    assert main([word.format(log=log, robot=pendulum) for word in words]) == 2
    assert "log.csv is no folder; name a file in another place" in capsys.readouterr().err


ARM = str(ROBOTS / "pendulum.urdf")


@pytest.fixture
def dataset(tmp_path):
    """A LeRobot dataset of three episodes of one joint, and a map of its columns."""
    folder = tmp_path / "dataset"
    (folder / "meta").mkdir(parents=True)
    (folder / "data" / "chunk-000").mkdir(parents=True)
    feature = {"dtype": "float32", "shape": [1], "names": ["swing.pos"]}
    info = {"total_episodes": 3, "features": {"observation.state": feature, "action": feature}}
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    for k in range(3):
        t = np.arange(100 + k) / 30
        lists = (20 * np.sin(3 * t))[:, None].tolist()
        columns = {"observation.state": lists, "action": lists, "timestamp": t, "episode_index": np.full(len(t), k)}
        pq.write_table(pa.table(columns), folder / "data" / "chunk-000" / f"episode_{k:06d}.parquet")
    path = tmp_path / "columns.yaml"
    path.write_text("t: timestamp\nq.swing: {from: observation.state.swing.pos, unit: deg}\n")
    return str(folder), str(path)


def test_every_episode_of_a_dataset_is_checked_as_a_recording(dataset, capsys):
    folder, columns = dataset
    assert main(["check", folder, "--columns", columns]) == 0
    said = capsys.readouterr().out
    assert [f"episode_{k:06d}: {100 + k} samples" in said for k in range(3)] == [True, True, True]


def test_episodes_are_chosen_by_the_option(dataset, capsys):
    folder, columns = dataset
    assert main(["check", folder, "--columns", columns, "--episodes", "1:2"]) == 0
    said = capsys.readouterr().out
    assert "episode_000001: 101 samples" in said
    assert "episode_000000" not in said


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--episodes", "3:9"], "has the episodes 0 to 2"),
        (["--columns", "ur_rtd"], "did you mean ur_rtde?"),
        ([], "does not say the unit of its joints"),
    ],
)
def test_what_cannot_be_read_ends_with_one_sentence(dataset, capsys, options, said):
    assert main(["check", dataset[0], *options]) == 2
    assert said in capsys.readouterr().err


def test_a_command_for_one_recording_asks_for_one_episode(dataset, capsys, tmp_path):
    words = ["degrade", ARM, dataset[0], "--effect", "backlash", "--joint", "swing", "--set", "gap=0.01"]
    assert main([*words, "--out", str(tmp_path / "cheap.csv")]) == 2
    assert "has 3 episodes, wanted one: choose it, as in --episodes 0" in capsys.readouterr().err
