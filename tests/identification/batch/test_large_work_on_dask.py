"""Maps and recordings on a real Dask scheduler with two worker processes. Oracle: the same call in this process alone.

A worker is killed (SIGKILL, no nanny that would start it again) as soon as the first piece is done: pieces that it has
begun, and those that it has finished and not yet handed over, are then lost with it.
"""

import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from distributed import Client
from joblib import parallel_config

from identification.batch.diagnose_each import diagnose_each
from identification.export.file_names import NAMES as MODELS
from identification.reporting.stored.diagnosis_files import INDEX, REPORT
from identification.stages import Announcement
from phantom_dyn import load_robot
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.maps import operational_map as streaming
from phantom_dyn.maps.from_robot import map_model
from phantom_dyn.maps.grid import read_grid
from phantom_dyn.maps.operational_map import operational_map
from phantom_dyn.motion import Motion
from places import ROBOTS

PENDULUM = ROBOTS / "pendulum.urdf"
QUANTITIES = ("manipulability", "apparent_mass_matrix", "gravity_force")
ON = "127.0.0.1"


class Cluster:
    """A scheduler and its workers, each a process of its own that knows nothing of this one."""

    def __init__(self, folder: Path):
        self._folder, self._address = folder, folder / "scheduler.json"
        self._workers: list[subprocess.Popen] = []
        self._scheduler = self._start("dask_scheduler", "--port", "0", "--no-dashboard")
        while not self._address.exists():
            assert self._scheduler.poll() is None, "the scheduler ended"
            time.sleep(0.02)
        self.client = Client(scheduler_file=str(self._address))

    def _start(self, what: str, *words: str) -> subprocess.Popen:
        command = [sys.executable, "-m", f"distributed.cli.{what}", "--host", ON, *words]
        # A working folder of their own: nothing may rest on the caller's.
        command += ["--scheduler-file", str(self._address)]
        return subprocess.Popen(command, cwd=self._folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def fill(self) -> None:
        """Start workers until there are two."""
        self._workers = [worker for worker in self._workers if worker.poll() is None]
        while len(self._workers) < 2:
            self._workers.append(
                self._start("dask_worker", "--no-nanny", "--nthreads", "1", "--no-dashboard", "--nworkers", "1")
            )
        self.client.wait_for_workers(2, timeout=300)

    def kill_one(self) -> None:
        """Kill a worker that has pieces to work on; return when it is gone."""
        worker = self._workers.pop()
        worker.kill()
        worker.wait()

    def close(self) -> None:
        """End all processes."""
        self.client.close()
        for process in (*self._workers, self._scheduler):
            process.kill()
            process.wait()


@pytest.fixture(scope="module")
def started(tmp_path_factory):
    running = Cluster(tmp_path_factory.mktemp("dask"))
    yield running
    running.close()


@pytest.fixture
def cluster(started):
    """Two workers, and joblib told to use them."""
    started.fill()
    with parallel_config(backend="dask"):
        yield started


@pytest.fixture
def killing(cluster):
    """A progress callback that kills a worker when the first piece is done, and a check that it was called."""
    said = []

    def progress(_: object) -> None:
        if not said:
            cluster.kill_one()
        said.append(time.monotonic())

    yield progress
    assert len(said) > 2, "the worker was killed at the end"
    assert len(cluster.client.ncores()) == 1


@pytest.fixture(scope="module")
def model():
    return map_model(load_robot("phantom_1_5"))


@pytest.fixture(scope="module")
def grid(model):
    return read_grid("x=-0.1:0.1:40,y=-0.2:0.25:40,z=-0.15:0.15:20", model.joint_names)


@pytest.fixture
def small_blocks(monkeypatch):
    """32 pieces of a map instead of 4."""
    monkeypatch.setattr(streaming, "BLOCK", 1000)


@pytest.fixture(scope="module")
def recordings(tmp_path_factory) -> list[str]:
    """Four swings of the pendulum with 0.2 and 0.4 more friction than its model, and one that is too short."""
    folder = tmp_path_factory.mktemp("recordings")
    robot = load_robot(PENDULUM)
    out = []
    for seed, seconds in enumerate((5.0, 5.0, 5.0, 5.0, 1.0)):
        rng = np.random.default_rng(seed)
        t = np.arange(0.0, seconds, 0.005)
        w = 2 * np.pi * rng.uniform(0.2, 1.0, 4)
        angle = np.outer(t, w) + rng.uniform(0, 2 * np.pi, 4)
        q, v, a = (
            (0.3 * wave).sum(axis=1)[:, None] for wave in (np.sin(angle), w * np.cos(angle), -(w**2) * np.sin(angle))
        )
        tau = inverse_dynamics(robot, Motion(t, q, v, a)) + 0.2 * (1 + seed % 2) * np.sign(v)
        tau += 0.01 * rng.standard_normal(tau.shape)
        out.append(str(folder / f"run{seed}.csv"))
        np.savetxt(out[-1], np.hstack([t[:, None], q, tau]), "%.17g", ",", header="t,q.pin,tau.pin", comments="")
    return out


@pytest.fixture(scope="module")
def alone(recordings):
    """The verdicts of a run in this process."""
    return diagnose_each(load_robot(PENDULUM), recordings, jobs=1)


def without_its_run(result):
    rows = []
    for row in result.rows:
        kept = (row.document or {}).items()
        document = None if row.document is None else {k: x for k, x in kept if k not in ("seconds", "run")}
        rows.append((row.log, row.folder, row.verdict, row.causes, row.refusal, document))
    return rows


def assert_same_map(found, expected):
    for name in QUANTITIES:
        np.testing.assert_array_equal(found.values[name], expected.values[name])
    assert (found.unreachable, found.singular) == (expected.unreachable, expected.singular)


def test_a_map_on_two_workers_is_the_same(cluster, model, grid, small_blocks):
    assert_same_map(operational_map(model, grid, QUANTITIES), operational_map(model, grid, QUANTITIES, jobs=1))


def test_a_map_survives_the_loss_of_a_worker(killing, model, grid, small_blocks):
    found = operational_map(model, grid, QUANTITIES, progress=killing)
    assert_same_map(found, operational_map(model, grid, QUANTITIES, jobs=1))


def test_recordings_on_two_workers_give_the_same_verdicts(cluster, recordings, alone):
    assert without_its_run(diagnose_each(load_robot(PENDULUM), recordings)) == without_its_run(alone)


def test_a_worker_writes_the_files_into_the_folder_that_the_caller_named(cluster, recordings, tmp_path, monkeypatch):
    # Oracle: the document that came back; workers have another working folder.
    monkeypatch.chdir(tmp_path)
    found = diagnose_each(load_robot(PENDULUM), recordings[:1] + recordings[-1:], out="out")
    written = {str(path.relative_to(tmp_path)): path for path in tmp_path.rglob("*") if path.is_file()}
    assert sorted(written) == sorted(f"out/run0/{name}" for name in (INDEX, REPORT, *MODELS))
    assert json.loads(written["out/run0/diagnosis.json"].read_text()) == json.loads(json.dumps(found.rows[0].document))


def test_recordings_survive_the_loss_of_a_worker(killing, recordings, alone):
    def progress(now: Announcement) -> None:
        if now.of:
            killing(now)

    found = diagnose_each(load_robot(PENDULUM), recordings, progress=progress)
    assert without_its_run(found) == without_its_run(alone)


def test_what_is_compared_is_a_diagnosis(alone):
    # Known truth: friction was added to four recordings, and one is a second long.
    verdicts = [(row.verdict, row.causes) for row in alone.rows]
    assert verdicts == [("explained", ("Coulomb friction on joint pin",))] * 4 + [("refused", ())]
