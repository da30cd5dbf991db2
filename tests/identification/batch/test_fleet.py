"""Who is out of line and what changed in a fleet. Oracles: known truth of made-up sizes, and the level of the tests.

Maps and recordings on a real Dask scheduler with two worker processes. Oracle: the same call in this process alone.

A worker is killed (SIGKILL, no nanny that would start it again) as soon as the first piece is done: pieces that it has
begun, and those that it has finished and not yet handed over, are then lost with it.
"""

import json
import re
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from distributed import Client
from joblib import parallel_config

from identification.batch.diagnose_each import DiagnosedRecording, DiagnosedRecordings, diagnose_each
from identification.batch.fleet import Series, change_point, changes, out_of_line, series_of
from identification.batch.fleet_page import fleet_lines, fleet_page
from identification.export.file_names import NAMES as MODELS
from identification.reporting.stored.diagnosis_files import INDEX, REPORT
from identification.stages import Announcement
from phantom_dyn import load_robot
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.maps import operational_map as streaming
from phantom_dyn.maps.grid import read_grid
from phantom_dyn.maps.map_model import map_model
from phantom_dyn.maps.operational_map import operational_map
from phantom_dyn.motion import Motion
from places import ROBOTS


def recording(robot: str, day: int, size: float | None, std: float = 0.02) -> DiagnosedRecording:
    """One row of a table whose only finding is Coulomb friction of j1."""
    parameters = {"torque": {"value": size, "std": std, "unit": "N m"}}
    finding = {"effect": "coulomb_friction", "joint": "j1", "parameters": parameters}
    document = {"findings": [] if size is None else [finding]}
    return DiagnosedRecording(f"/fleet/{robot}/day{day:02}.csv", f"{robot}{day}", "explained", (), document)  # pyright: ignore[reportArgumentType]


def fleet(*rows: DiagnosedRecording) -> DiagnosedRecordings:
    return DiagnosedRecordings("arm", ("j1",), rows)


@pytest.fixture
def six(rng) -> list[DiagnosedRecording]:
    """Six robots with ten days each, alike but for their own level."""
    return [
        recording(f"r{k}", day, 0.5 + 0.02 * level + 0.02 * rng.standard_normal())
        for k, level in enumerate(rng.standard_normal(6))
        for day in range(10)
    ]


def test_a_robot_with_three_times_the_friction_is_out_of_line(six, rng):
    rows = [row for row in six if "/r3/" not in row.log]
    rows += [recording("r3", day, 1.5 + 0.02 * rng.standard_normal()) for day in range(10)]
    found = out_of_line(series_of(fleet(*rows)))
    assert [one.robot for one in found] == ["r3"]
    assert found[0].value == pytest.approx(1.5, abs=0.03)
    assert found[0].others == pytest.approx(0.5, abs=0.05)


def test_a_robot_that_alone_lacks_a_finding_is_out_of_line(six):
    rows = [row for row in six if "/r2/" not in row.log] + [recording("r2", day, None) for day in range(10)]
    assert [one.robot for one in out_of_line(series_of(fleet(*rows)))] == ["r2"]


def test_another_finding_on_the_joint_may_stand_for_the_missing_one(six):
    parameters = {"coulomb_torque": {"value": 0.5, "std": 0.02, "unit": "N m"}}
    document = {"findings": [{"effect": "stribeck_friction", "joint": "j1", "parameters": parameters}]}
    other = DiagnosedRecording("/fleet/r9/day00.csv", "r9", "explained", (), document)  # pyright: ignore[reportArgumentType]
    assert out_of_line(series_of(fleet(*six, other))) == ()


def test_a_step_is_found_at_its_recording(six, rng):
    rows = [row for row in six if "/r1/" not in row.log]
    rows += [recording("r1", day, (0.5 if day < 6 else 0.62) + 0.02 * rng.standard_normal()) for day in range(10)]
    found = changes(series_of(fleet(*rows)))
    assert [(one.robot, one.since, one.drifts) for one in found] == [("r1", "day06.csv", False)]
    assert found[0].after - found[0].before == pytest.approx(0.12, abs=0.04)


def test_a_drift_is_reported_from_its_beginning(rng):
    sizes = [0.5 + 0.02 * max(0, day - 4) + 0.002 * rng.standard_normal() for day in range(12)]
    (found,) = changes(series_of(fleet(*(recording("r", day, size) for day, size in enumerate(sizes)))))
    assert (found.drifts, found.since) == (True, "day04.csv")
    assert (found.before, found.after) == pytest.approx((0.5, 0.64), abs=0.005)


def test_a_step_among_six_recordings_is_found_where_others_show_the_scatter(six, rng):
    # By hand: of six values in random orders one in ten has the same three at one end; the others' scatter says more.
    own = [recording("r9", day, (0.5 if day < 3 else 0.7) + 0.02 * rng.standard_normal()) for day in range(6)]
    assert [(one.robot, one.since) for one in changes(series_of(fleet(*six, *own)))] == [("r9", "day03.csv")]
    assert changes(series_of(fleet(*own))) == ()


def test_a_finding_that_appears_beside_another_is_a_change(six):
    # Viscous friction is found beside Coulomb friction, which so does not stand for it where it is missing.
    grown = []
    for day in range(8):
        row = recording("r9", day, 0.5)
        viscous = {"coefficient": {"value": 0.25, "std": 0.01, "unit": "N m s/rad"}}
        if day >= 5:
            row.document["findings"].append({"effect": "viscous_friction", "joint": "j1", "parameters": viscous})  # pyright: ignore[reportOptionalSubscript, reportAttributeAccessIssue]
        grown.append(row)
    found = changes(series_of(fleet(*six, *grown)))
    assert [(one.robot, one.quantity, one.since) for one in found] == [
        ("r9", "Viscous friction on joint j1 (coefficient)", "day05.csv")
    ]
    assert (found[0].before, found[0].after) == pytest.approx((0.0, 0.25))


def test_a_single_recording_is_no_change(six, rng):
    rows = [recording("r9", day, 0.9 if day == 9 else 0.5 + 0.02 * rng.standard_normal()) for day in range(10)]
    assert changes(series_of(fleet(*six, *rows))) == ()


def test_what_is_a_change_of_one_robot_alone_may_be_chance_in_a_fleet():
    # Oracle: Holm's first level, 5 % / 1 alone and 5 % / 9 beside eight that are flat.
    def series(robot: str, quantity: str, values: np.ndarray) -> Series:
        return Series(robot, quantity, "torque", "N m", tuple(map(str, range(9))), values, np.full(9, 1.0))

    stepped = series("r0", "A", np.array([0.3, -1.1, 0.6, -0.4, 0.9, 1.3, 1.9, 0.8, 2.3]))
    p = change_point(stepped.values, stepped.stds).p
    assert 0.05 / 9 < p < 0.05
    flat = np.array([1.0, -1.0, 0.5, -0.5, 0.0, 0.5, -0.5, 1.0, -1.0])
    others = tuple(series(f"r{k}", name, flat) for k in (1, 2) for name in "BCDE")
    assert [one.robot for one in changes((stepped,))] == ["r0"]
    assert changes((stepped, *others)) == ()


@pytest.mark.parametrize("others", [0, 5])
def test_chance_is_called_a_change_as_rarely_as_stated(rng, others):
    p = []
    for _ in range(200):
        apart = [values - values.mean() for values in rng.standard_normal((others, 9))]
        scatter = np.concatenate(apart) * np.sqrt(9 / 8) if others else None
        p.append(change_point(rng.standard_normal(9), np.ones(9), scatter).p)
    # Binomial: at 5 % of 200, more than 20 are one in a thousand.
    assert np.sum(np.array(p) <= 0.05) <= 20
    assert np.mean(p) == pytest.approx(0.5, abs=0.08)


def test_chance_is_called_out_of_line_as_rarely_as_stated(rng):
    alarms = 0
    for _ in range(200):
        rows = [recording(f"r{k}", 0, 0.5 + 0.1 * rng.standard_normal(), std=1e-4) for k in range(6)]
        alarms += bool(out_of_line(series_of(fleet(*rows))))
    assert alarms <= 20


def test_three_robots_are_too_few_to_judge_one():
    rows = [recording(f"r{k}", 0, size) for k, size in enumerate((0.5, 0.5, 5.0))]
    assert out_of_line(series_of(fleet(*rows))) == ()


def test_the_page_says_what_the_lines_say_and_runs_nothing(six, rng):
    rows = [*six, *(recording("<b>", day, 3.0 + 0.02 * rng.standard_normal()) for day in range(10))]
    page = fleet_page(fleet(*rows))
    lines = fleet_lines(fleet(*rows))
    assert any(line.startswith("<b> is out of line: Coulomb friction on joint j1 (torque) is 3") for line in lines)
    assert "<td>&lt;b&gt;</td>" in page
    assert "<b>" not in page
    assert "<script" not in page
    assert page.count("</title></g>") == 70
    assert "torque [N m]" in page


def test_the_page_counts_recordings_and_verdicts_of_each_robot(six):
    refused = DiagnosedRecording("/fleet/r0/day99.csv", "x", "refused", refusal="empty")
    page = fleet_page(fleet(*six, refused))
    assert "<h1>arm: 6 robots, 61 recordings</h1>" in page
    assert "<tr><td>r0</td><td>11</td><td>10 explained, 1 refused</td><td>–</td></tr>" in page


def test_recordings_of_one_day_stand_above_each_other_and_are_named(six):
    page = fleet_page(fleet(*six))
    assert re.findall(r"day0\d(?=</text>)", page) == [f"day0{day}" for day in range(10)]


def test_a_page_without_findings_says_so():
    assert "No recording has a finding" in fleet_page(fleet(recording("a", 0, None)))


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
    """Two workers, which joblib uses."""
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


@pytest.mark.nightly
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
