"""A disk that is full, and homes that may not be written to. Oracle: the system's own limit on the size of files."""

from __future__ import annotations

import errno
import os
import resource
import subprocess
import sys

import pytest

from identification.cli.main import main
from places import ROBOTS

pytestmark = pytest.mark.whole

PENDULUM = str(ROBOTS / "pendulum.urdf")


@pytest.fixture
def command(tmp_path):
    """Runs the command in a process of its own, which may write files of so many bytes."""

    def run(line: str, *, most: int = resource.RLIM_INFINITY, **environment: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-m", "identification.cli", *line.split()],
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (most, most)),
            # Python would cut its own byte code off at the limit, and a later process would stumble over it.
            env=os.environ | {"PYTHONDONTWRITEBYTECODE": "1", "PYTHONPYCACHEPREFIX": "/proc/nowhere"} | environment,
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
        )

    return run


@pytest.mark.parametrize(
    "line",
    [
        f"excite {PENDULUM} --duration 5 --out new.csv",
        f"identify {PENDULUM} log.csv --out new",
        f"diagnose {PENDULUM} log.csv --out new",
    ],
    ids=lambda line: line.split()[0],
)
def test_a_full_disk_is_one_sentence_and_leaves_no_half_of_a_file(line, command, log, tmp_path):
    done = command(line, most=700)
    assert done.returncode == 2
    told = [text for text in done.stderr.splitlines() if text.startswith("phantom-dyn: ")]
    assert len(told) == 1
    assert "Traceback" not in done.stderr
    assert "file too large" in told[0]
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == [log]


@pytest.mark.nightly
def test_a_disk_that_fills_while_netcdf_is_written_is_told_too(command):
    # NetCDF's own error says nothing of a disk, and its file is the larger one.
    line = "map phantom_1_5 --quantity manipulability --grid x=0:0.02:2,y=0:0.02:2,z=0:0.02:2 --out"
    assert command(f"{line} whole").returncode == 0  # compiled loops are kept from now on
    done = command(f"{line} m", most=5000)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert "map.nc: netcdf: hdf error, as on a full disk" in done.stderr


def test_a_batch_says_of_which_recording_nothing_could_be_written(log, tmp_path, monkeypatch, capsys):
    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("identification.batch.diagnose_each.write_outputs", full)
    assert main(["diagnose", PENDULUM, str(log), "--each", "--jobs", "1", "--out", str(tmp_path / "new")]) == 2
    told = " ".join(capsys.readouterr().out.split())
    assert "log.csv: nothing more can be written (no space left on device): free some space" in told
    assert "report this" not in told


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
