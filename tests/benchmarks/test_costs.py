"""Benchmarks of time: what each measures is what it says."""

import datetime
import re

import numpy as np
import pytest

from benchmarks import comparison, first_run, haptics_step_cost, speed_table
from benchmarks.compare_mujoco_sysid import worst
from benchmarks.comparison import NotInstalled, Row, environment, less_than, missed, more_than, table
from benchmarks.diagnosis_cost import Cost
from benchmarks.speed_table import BEGIN, END, inside, machine, main
from identification.data.reading import read_recording
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.model.loading import load_robot
from phantom_dyn.motion import Motion


@pytest.mark.whole
def test_the_recording_is_that_of_the_rod_with_friction(tmp_path):
    _, robot_file, log, *_ = first_run.words_for(1, tmp_path)
    robot = load_robot(robot_file)
    recording = read_recording(log, robot)
    speed = np.gradient(recording.q, recording.t, axis=0)
    motion = Motion(recording.t, recording.q, speed, np.gradient(speed, recording.t, axis=0))
    left = (recording.tau - inverse_dynamics(robot, motion)) * np.sign(speed)
    assert np.median(left) == pytest.approx(0.4, abs=0.01)


@pytest.mark.whole
def test_only_the_first_of_two_runs_finds_an_empty_folder(monkeypatch, capsys):
    seen = []

    def fresh(words):
        seen.append((first_run.os.environ["NUMBA_CACHE_DIR"], words[2]))
        return Cost(1.0, 12.0 if len(seen) == 1 else 3.0, 100.0)

    monkeypatch.setenv("NUMBA_CACHE_DIR", "")
    monkeypatch.setattr(first_run, "fresh_process", fresh)
    monkeypatch.setattr("sys.argv", ["first_run.py"])
    first_run.main()
    assert len({folder for folder, _ in seen}) == 1
    assert [command for _, command in seen] == ["diagnose", "diagnose"]
    assert "9.0 s more: reached" in capsys.readouterr().out


@pytest.fixture
def short(monkeypatch):
    monkeypatch.setattr(haptics_step_cost, "CYCLES", 200)


def test_cycles_are_apart_as_in_the_paper(short):
    steps, q, asked = haptics_step_cost.motion(np.random.default_rng(0))
    assert 1 / 2000 <= steps.min() < steps.max() <= 1 / 500
    assert q.shape == asked.shape == (6, 200)


@pytest.mark.whole
def test_each_degradation_of_the_paper_has_its_medians(short, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["haptics_step_cost.py"])
    haptics_step_cost.main()
    rows = re.findall(r"^\| ([a-z ]+) \| ([\d.]+) \| (\d+) \|$", capsys.readouterr().out, flags=re.MULTILINE)
    names = ["nothing", "saturation", "cogging", "friction", "inertia", "inertia and backlash", "all"]
    assert [row[0] for row in rows] == names
    # A call from Python checks and packs its arguments: it costs more than the same cycle inside the loop.
    assert all(0 < float(inside) < float(outside) for _, inside, outside in rows)


FAST = Row("fit", "3.0 s", "0.2 s", *more_than(15.0, 10.0))

LARGE = Row("memory", "300 MB", "150 MB", *less_than(0.5, 1 / 3, "at most a third"))

PAGE = f"before\n{BEGIN}\nold\n{END}\nafter\n"


def refused() -> list[Row]:
    raise NotInstalled("That tool could not be installed: the comparison with it is left out.")


def test_a_row_says_whether_what_was_wanted_is_reached():
    assert FAST.cells == ("fit", "3.0 s", "0.2 s", "15.0 times faster", "at least 10 times", "reached")
    assert LARGE.cells[3:] == ("0.50 of theirs", "at most a third", "missed")


def test_the_exit_code_is_1_where_a_target_is_missed():
    assert missed([FAST, Row("without a target", "", "", "")]) == 0
    assert missed([FAST, LARGE]) == 1


def test_all_lines_of_the_table_have_the_same_columns():
    lines = table([FAST, LARGE]).splitlines()
    assert len(lines) == 4
    assert {(len(line), line.count("|")) for line in lines} == {(len(lines[0]), 7)}


def test_a_file_without_markers_is_refused_before_anything_is_measured(tmp_path, monkeypatch):
    path = tmp_path / "page.md"
    path.write_text("no markers")
    monkeypatch.setattr(speed_table, "_parts", lambda repeats: pytest.fail("measured"))
    with pytest.raises(ValueError, match="put them where the table goes"):
        main(["--page", str(path)])
    assert path.read_text() == "no markers"


def test_the_table_goes_between_the_markers_and_the_exit_code_says_what_it_holds(tmp_path, monkeypatch, capsys):
    path = tmp_path / "page.md"
    path.write_text(PAGE)
    monkeypatch.setattr(speed_table, "_parts", lambda repeats: [lambda: [FAST], refused, lambda: [LARGE]])
    assert main(["--page", str(path)]) == 1
    written = path.read_text()
    assert written.startswith(f"before\n{BEGIN}\nMeasured on ")
    assert written.endswith(f"left out.\n{END}\nafter\n")
    assert table([FAST, LARGE]) in written
    assert table([FAST, LARGE]) in capsys.readouterr().out


def test_the_heading_names_day_command_and_machine():
    text = inside([FAST], [], datetime.date(2026, 11, 21), "a machine").replace("\n", " ")
    assert text.startswith("Measured on 2026-11-21 with `make speed` in one run on a machine: ")


def test_the_machine_is_named_with_its_processor(tmp_path):
    cpuinfo = tmp_path / "cpuinfo"
    cpuinfo.write_text("processor: 0\nmodel name\t: Some Processor 3000\n")
    assert machine(cpuinfo).startswith("Some Processor 3000, ")


def test_an_environment_that_cannot_be_made_is_one_sentence(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))

    def fails(*_, **__):
        raise OSError("no space left")

    monkeypatch.setattr(comparison.venv, "create", fails)
    with pytest.raises(NotInstalled, match=r"^tool==1 could not be installed \(OSError\): the comparison .* left out"):
        environment("tool", "tool==1", "tool")


def test_a_worker_that_fails_says_why():
    with pytest.raises(RuntimeError, match=r"own_worker\.py ended with exit code 1"):
        comparison.own("own_worker.py", "no such work", "example:ur10")


def test_the_worst_parameter_counts_by_its_true_value():
    assert worst({"a": 1.1, "b": 4.0}, {"a": 1.0, "b": 5.0}) == pytest.approx(20.0)
