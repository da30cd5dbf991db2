"""phantom-dyn with many recordings, on a full disk, and at the end of a process."""

import errno
import json
import os
import re
import resource
import subprocess
import sys
from pathlib import Path

import pytest

from by_night import by_night
from identification.cli.main import main
from identification.export.file_names import NAMES as MODELS
from identification.reporting.stored.diagnosis_files import INDEX, REPORT
from places import ROBOTS


@pytest.fixture(scope="module")
def logs(tmp_path_factory, pendulum, made_columns, written) -> Path:
    """Folder with one recording that is diagnosed and one that is refused."""
    folder = tmp_path_factory.mktemp("logs")
    written(folder / "good.csv", made_columns(pendulum, seconds=5.0))
    (folder / "short.csv").write_text("t,q.pin,tau.pin\n0,0,1\n")
    return folder


@pytest.fixture(scope="module")
def finished(tmp_path_factory, pendulum, logs):
    """Folder of the files of one run over both, and its exit code."""
    out = tmp_path_factory.mktemp("finished") / "out"
    return out, main(["diagnose", str(pendulum), str(logs), "--each", "--jobs", "1", "--out", str(out)])


@pytest.mark.whole
def test_one_refused_recording_is_exit_code_2_and_the_others_are_written(finished):
    out, code = finished
    written = sorted(str(path.relative_to(out)) for path in out.rglob("*.*"))
    ours = ["diagnoses.csv", "diagnoses.json", "fleet.html", *(f"good/{name}" for name in (INDEX, REPORT, *MODELS))]
    assert (code, written) == (2, sorted(ours))


@pytest.mark.whole
def test_recordings_that_are_all_diagnosed_are_exit_code_0(pendulum, logs, capsys):
    assert main(["diagnose", "--each", str(pendulum), str(logs / "good.csv")]) == 0
    shown = capsys.readouterr()
    assert re.search(r"^good\.csv +explained +Coulomb friction on joint pin$", shown.out, re.MULTILINE)
    assert shown.err == ""


@pytest.mark.whole
def test_without_out_and_json_nothing_is_written(pendulum, logs, monkeypatch):
    before = sorted(logs.iterdir())
    monkeypatch.chdir(logs)
    main(["diagnose", "--each", str(pendulum), "short.csv"])
    assert sorted(logs.iterdir()) == before


@pytest.mark.whole
def test_a_refusal_is_counted_on_standard_error(pendulum, logs, capsys):
    assert main(["diagnose", "--each", str(pendulum), str(logs / "short.csv"), "--json", str(logs / "x.txt")]) == 2
    shown = capsys.readouterr()
    assert shown.err == "phantom-dyn: 1 of 1 recordings was refused; the table says why\n"
    assert re.search(r"^short\.csv +refused +short\.csv", shown.out, re.MULTILINE)
    assert json.loads((logs / "x.txt").read_text())["recordings"][0]["verdict"] == "refused"


@pytest.mark.parametrize("name", ["diagnoses.csv", "fleet.html", "good/corrected.xml"])
def test_a_file_of_the_user_is_refused_before_the_work(pendulum, logs, capsys, tmp_path, name):
    (tmp_path / "out" / name).parent.mkdir(parents=True)
    (tmp_path / "out" / name).write_text("by hand")
    assert main(["diagnose", str(pendulum), str(logs / "good.csv"), "--each", "--out", str(tmp_path / "out")]) == 2
    shown = capsys.readouterr()
    assert f"{name} was not written by phantom-dyn, and would be written over" in shown.err
    assert shown.out == ""


@pytest.mark.whole
def test_recordings_cannot_be_held_out(pendulum, logs, refusal):
    sentence = refusal(pendulum, logs / "good.csv", "--each", "--hold-out", logs / "short.csv")
    assert re.search(r"--hold-out was given with --each, which diagnoses every recording by itself", sentence)


PENDULUM = str(ROBOTS / "pendulum.urdf")


@pytest.fixture
def command(tmp_path):
    """Runs the command in a process of its own, which may write files of so many bytes."""

    def run(line: str, *, most: int = resource.RLIM_INFINITY, **environment: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-m", "identification.cli", *line.split()],
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (most, most)),
            # Python would cut its own byte code off at the limit, and a later process would stumble over it.
            env=os.environ | {"PYTHONDONTWRITEBYTECODE": "1"} | environment,
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
        )

    return run


@pytest.mark.whole
@pytest.mark.parametrize(
    "line",
    by_night(
        [
            f"excite {PENDULUM} --duration 5 --out new.csv",
            f"identify {PENDULUM} log.csv --out new",
            f"diagnose {PENDULUM} log.csv --out new",
        ],
        2,
    ),
    ids=lambda line: line.split()[0],
)
def test_a_full_disk_is_one_sentence_and_leaves_no_half_of_a_file(line, command, log, tmp_path):
    done = command(line, most=700)
    assert done.returncode == 2
    said = [text for text in done.stderr.splitlines() if text.startswith("phantom-dyn: ")]
    assert len(said) == 1
    assert "Traceback" not in done.stderr
    assert "file too large" in said[0]
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == [log]


@pytest.mark.whole
@pytest.mark.nightly
def test_a_disk_that_fills_while_netcdf_is_written_is_reported_too(command):
    # NetCDF's own error says nothing of a disk, and its file is the larger one.
    line = "map phantom_1_5 --quantity manipulability --grid x=0:0.02:2,y=0:0.02:2,z=0:0.02:2 --out"
    assert command(f"{line} whole").returncode == 0  # compiled loops are kept from now on
    done = command(f"{line} m", most=5000)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert "map.nc: netcdf: hdf error, as on a full disk" in done.stderr


@pytest.mark.whole
def test_a_batch_says_of_which_recording_nothing_could_be_written(log, tmp_path, monkeypatch, capsys):
    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("identification.batch.diagnose_each.write_outputs", full)
    assert main(["diagnose", PENDULUM, str(log), "--each", "--jobs", "1", "--out", str(tmp_path / "new")]) == 2
    said = " ".join(capsys.readouterr().out.split())
    assert "log.csv: nothing more can be written (no space left on device): free some space" in said
    assert "report this" not in said


@pytest.mark.whole
def test_a_home_that_may_not_be_written_to_is_no_matter(command, log, tmp_path):
    # /proc takes no file from anybody; the superuser may write into any folder that is only marked read-only.
    nowhere = dict.fromkeys(
        ("HOME", "XDG_CACHE_HOME", "XDG_CONFIG_HOME", "NUMBA_CACHE_DIR", "MPLCONFIGDIR"), "/proc/nowhere"
    )
    done = command(f"diagnose {PENDULUM} log.csv --out new", **nowhere)
    assert done.returncode == 0, done.stderr
    assert "explained by Coulomb friction" in done.stdout
    assert (tmp_path / "new" / "report.html").is_file()
    assert "Traceback" not in done.stderr


START = "from identification.cli.__main__ import started"


def run(*lines: str, words: tuple[str, ...] = ("--version",)) -> subprocess.CompletedProcess[str]:
    code = "\n".join(("import atexit, sys", START, f"sys.argv = ['phantom-dyn', *{words!r}]", *lines))
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)


def test_what_a_command_prints_arrives_in_a_pipe():
    assert run("sys.exit(started())").stdout.startswith("phantom-dyn ")


def test_the_exit_code_of_the_process_is_the_commands():
    assert run("sys.exit(started())", words=("diagnose",)).returncode == 2


def test_what_libraries_leave_to_do_at_the_end_is_done():
    assert run("code = started()", "atexit.register(print, 'closed')", "sys.exit(code)").stdout.endswith("closed\n")


def test_an_error_of_ours_ends_with_its_traceback_and_code_1():
    broken = ("import identification.cli.main", "identification.cli.main.COMMANDS = None", "sys.exit(started())")
    ended = run(*broken, words=("diagnose", "r", "l"))
    assert (ended.returncode, ended.stderr.splitlines()[0]) == (1, "Traceback (most recent call last):")


def test_a_stream_that_takes_no_more_is_reported():
    code = f"{START}\nimport sys\nsys.argv = ['phantom-dyn', '--version']\nstarted()\nprint('more')"
    with Path("/dev/full").open("w") as full:
        words = [sys.executable, "-c", code]
        ended = subprocess.run(words, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert ended.returncode != 0
    assert "space left" in ended.stderr
