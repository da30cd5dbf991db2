"""One recording gives one answer: with one and two threads, other hashes, one and two jobs, again and again.

Oracles: what another process writes, byte for byte but for times and the run's own name; threadpoolctl.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from identification.cli.main import main
from identification.data.reading import read_recording
from identification.identify.identify import identify
from identification.pipeline import diagnose
from phantom_dyn.model.loading import load_robot
from places import ROBOTS

pytestmark = pytest.mark.whole

ROBOT = ROBOTS / "planar2.urdf"


@pytest.fixture(scope="module")
def logs(tmp_path_factory, made_columns, written) -> tuple[Path, Path]:
    """Two short recordings of two joints."""
    folder = tmp_path_factory.mktemp("logs")
    one, other = (made_columns(ROBOT, seconds=8.0, rate=100.0, seed=seed) for seed in (0, 1))
    return written(folder / "a.csv", one), written(folder / "b.csv", other)


def lasting(file: Path) -> str:
    """The text of a diagnosis without what is of its run alone."""
    content = json.loads(file.read_text())
    return json.dumps(content | {"run": None, "seconds": None, "files": None})


def in_a_process(log: Path, out: Path, *, threads: int, hashes: int) -> str:
    """What the command writes with so many threads and such a seed of Python's hashes."""
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    environment = os.environ | dict.fromkeys(names, str(threads)) | {"PYTHONHASHSEED": str(hashes)}
    words = [sys.executable, "-m", "identification.cli", "diagnose", str(ROBOT), str(log), "--json", str(out)]
    subprocess.run(words, env=environment, check=True, capture_output=True)
    return lasting(out)


def test_threads_hashes_and_processes_change_nothing(logs, tmp_path):
    one = in_a_process(logs[0], tmp_path / "one.json", threads=1, hashes=0)
    two = in_a_process(logs[0], tmp_path / "two.json", threads=2, hashes=1)
    assert one == two
    assert '"findings": [{' in one


@pytest.mark.nightly
def test_jobs_change_nothing_nor_does_a_batch(logs, tmp_path):
    for jobs in (1, 2):
        words = ["diagnose", str(ROBOT), *map(str, logs), "--each", "--jobs", str(jobs)]
        assert main([*words, "--out", str(tmp_path / str(jobs))]) == 0
    assert main(["diagnose", str(ROBOT), str(logs[0]), "--json", str(tmp_path / "alone.json")]) == 0
    for name in ("a", "b"):
        assert lasting(tmp_path / "1" / name / "diagnosis.json") == lasting(tmp_path / "2" / name / "diagnosis.json")
    assert lasting(tmp_path / "1" / "a" / "diagnosis.json") == lasting(tmp_path / "alone.json")


@pytest.mark.parametrize("work", [diagnose, identify])
def test_linear_algebra_has_one_thread_whatever_was_set(work, logs):
    robot = load_robot(ROBOT)
    threads = set()

    def progress(_: object) -> None:
        threads.update(library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas")

    with threadpool_limits(limits=2, user_api="blas"):
        work(robot, (read_recording(logs[0], robot),), progress=progress)
    assert threads == {1}


@pytest.mark.parametrize(
    "line",
    [
        "check no.csv",
        "compare no.json nor.json",
        "degrade no.urdf no.csv --effect coulomb_friction --joint j --set torque=1 --out x.csv",
        "diagnose no.urdf no.csv",
        "excite no.urdf --duration 10 --out x.csv",
        "identify no.urdf no.csv --out x",
        "map no.urdf --quantity manipulability --grid x=0:1:2 --out x",
        "view no.urdf no.csv",
    ],
)
def test_every_command_that_computes_asks_for_one_thread_before_numpy_is_loaded(line, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "2")
    assert main(line.split()) == 2
    assert os.environ["OPENBLAS_NUM_THREADS"] == "1"
