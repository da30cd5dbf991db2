"""Pieces of large work over processes and threads. Oracles: the same calls one after the other; threadpoolctl."""

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import cloudpickle
import numpy as np
import pytest
from joblib import parallel_config
from joblib.externals.loky import get_reusable_executor
from threadpoolctl import threadpool_info, threadpool_limits

from phantom_dyn import load_robot
from phantom_dyn._kernels.regressor_loop import regressor_loop
from phantom_dyn._kernels.rigid_body_loops import frame_loop, mass_loop, torque_loop
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.errors import ParameterError
from phantom_dyn.large_work import WorkerLostError, spread, starts_processes, worker_count
from phantom_dyn.maps import operational_map as streaming
from phantom_dyn.maps.from_robot import map_model
from phantom_dyn.maps.grid import read_grid
from phantom_dyn.maps.operational_map import operational_map
from phantom_dyn.motion import Motion


@pytest.fixture
def sent_whole():
    """What this file defines is sent whole: processes of joblib cannot import a test."""
    here = sys.modules[__name__]
    cloudpickle.register_pickle_by_value(here)
    yield
    cloudpickle.unregister_pickle_by_value(here)
    get_reusable_executor().shutdown(wait=True)


def square(x: float) -> float:
    return x * x


def end_once(marker: str, x: int) -> int:
    """The square, but the first process that is asked for that of 2 is killed, as by the kernel out of memory."""
    if x == 2 and not Path(marker).exists():
        Path(marker).touch()
        time.sleep(0.5)  # others are finished and handed over
        os.kill(os.getpid(), signal.SIGKILL)
    return x * x


def end_always(x: int) -> int:
    if x == 2:
        time.sleep(0.2)
        os.kill(os.getpid(), signal.SIGKILL)
    return x * x


def threads_of_blas() -> set[int]:
    time.sleep(0.05)  # both threads are inside at once
    return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}


def own_number() -> int:
    time.sleep(0.2)  # both processes have one
    return os.getpid()


def fail(x: int) -> int:
    raise ZeroDivisionError(x)


@pytest.mark.parametrize("jobs", [1, 2])
def test_every_result_comes_once_with_the_place_of_its_piece(sent_whole, jobs):
    assert sorted(spread(square, [(3,), (1,), (4,), (1,)], jobs=jobs)) == [(0, 9), (1, 1), (2, 16), (3, 1)]


def test_no_pieces_give_no_results():
    assert list(spread(square, [], jobs=2)) == []


def test_a_process_that_is_killed_is_survived(sent_whole, tmp_path):
    # Known truth: squares; the process that has the third of them ends without a word.
    pieces = [(str(tmp_path / "killed"), x) for x in range(6)]
    assert sorted(spread(end_once, pieces, jobs=2)) == [(x, x * x) for x in range(6)]
    assert (tmp_path / "killed").exists()


def test_a_piece_that_always_ends_its_process_is_named(sent_whole):
    with pytest.raises(WorkerLostError, match=r"ended 3 times, perhaps because memory ran out") as lost:
        list(spread(end_always, [(x,) for x in range(4)], jobs=2))
    assert 2 in lost.value.left


def test_an_error_of_a_piece_is_raised(sent_whole):
    with pytest.raises(ZeroDivisionError, match="7"):
        list(spread(fail, [(7,), (7,)], jobs=2))


@pytest.mark.parametrize("jobs", [0, -1])
def test_fewer_than_one_process_are_refused(jobs):
    with pytest.raises(ParameterError, match=f"jobs = {jobs} was given, wanted a number of processes from 1 on"):
        list(spread(square, [(1,)], jobs=jobs))


def test_the_number_of_workers_is_what_joblib_was_told():
    with parallel_config(n_jobs=3):
        assert (worker_count(None), worker_count(5), worker_count(1)) == (3, 5, 1)


def test_threads_need_no_processes_to_be_started():
    assert starts_processes()
    with parallel_config(backend="threading"):
        assert not starts_processes()


def test_linear_algebra_has_one_thread_in_every_piece_and_what_it_had_after():
    # Oracle: threadpoolctl.
    with threadpool_limits(limits=2), parallel_config(backend="threading", n_jobs=2):
        before = threads_of_blas()  # what a library was built for may allow one only
        inside = [threads for _, threads in spread(threads_of_blas, [()] * 4)]
        after = threads_of_blas()
    assert 2 in before
    assert (inside, after) == ([{1}] * 4, before)


def test_compiled_loops_in_threads_give_the_same_torque():
    # Oracle: one call after the other. UR10, random motion.
    robot = load_robot("example:ur10")
    rng = np.random.default_rng(0)
    motions = [Motion(np.arange(500.0), *(rng.uniform(-1, 1, (500, 6)) for _ in "qva")) for _ in range(8)]
    with parallel_config(backend="threading", n_jobs=2):
        found = dict(spread(inverse_dynamics, [(robot, motion) for motion in motions]))
    for place, motion in enumerate(motions):
        np.testing.assert_array_equal(found[place], inverse_dynamics(robot, motion))


@pytest.mark.parametrize("loop", [torque_loop, mass_loop, frame_loop, regressor_loop])
def test_a_compiled_loop_leaves_the_interpreter_to_other_threads(loop):
    # Oracle: numba's own record of how it compiles.
    assert loop.targetoptions["nogil"] is True


def test_a_map_in_threads_is_the_same(monkeypatch):
    model = map_model(load_robot("phantom_1_5"))
    grid = read_grid("x=-0.1:0.1:20,y=-0.2:0.25:20,z=-0.15:0.15:20", model.joint_names)
    monkeypatch.setattr(streaming, "BLOCK", 500)
    names = ["manipulability", "apparent_mass_matrix"]
    serial = operational_map(model, grid, names, jobs=1)
    with parallel_config(backend="threading", n_jobs=2):
        found = operational_map(model, grid, names)
    for name in names:
        np.testing.assert_array_equal(found.values[name], serial.values[name])


WITH_WORKERS = """
import sys, time
from phantom_dyn.large_work import spread
if __name__ == "__main__":
    for _ in spread(time.sleep, [(0.0,), (0.0,), (60.0,), (60.0,)], jobs=2):
        print("one", flush=True)
"""


WITH_HELD_WORKERS = """
import ctypes
from phantom_dyn.large_work import spread
def sleep(seconds):
    ctypes.PyDLL(None).sleep(seconds)
if __name__ == "__main__":
    for _ in spread(sleep, [(0,), (0,), (60,), (60,)], jobs=2):
        print("one", flush=True)
"""


def workers_of(token: str) -> list[str]:
    """Numbers of the processes whose environment holds a token."""
    found = []
    for place in Path("/proc").glob("[0-9]*/environ"):
        with contextlib.suppress(OSError):
            if f"LARGE_WORK_TEST={token}\0".encode() in place.read_bytes():
                found.append(place.parent.name)
    return found


def killed_with_its_workers(folder: Path, work: str, seconds: float) -> list[str]:
    """Workers that still live so long [s] after their main process was killed."""
    (folder / "work.py").write_text(work)
    token = folder.name
    environment = {**os.environ, "LARGE_WORK_TEST": token}
    child = subprocess.Popen([sys.executable, "work.py"], cwd=folder, env=environment, stdout=subprocess.PIPE)
    assert child.stdout is not None
    assert child.stdout.readline() == b"one\n"
    assert len(workers_of(token)) >= 3
    child.kill()
    child.wait()
    child.stdout.close()  # its workers hold the other end
    until = time.monotonic() + seconds
    while workers_of(token) and time.monotonic() < until:
        time.sleep(0.05)
    return workers_of(token)


def test_workers_end_with_the_process_that_is_killed(tmp_path):
    # Oracle: the system's list of processes.
    assert killed_with_its_workers(tmp_path, WITH_WORKERS, 20) == []


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only the kernel of Linux ends processes so")
def test_workers_end_though_compiled_code_holds_the_interpreter(tmp_path):
    # Oracle: the system's list of processes. PyDLL keeps the lock of the interpreter, so that no thread of the worker
    # can look whether its parent lives.
    assert killed_with_its_workers(tmp_path, WITH_HELD_WORKERS, 20) == []


def test_workers_of_a_thread_are_left_for_the_next_call(sent_whole):
    # Known truth: the kernel would end them with the thread that started them.
    found: list[int] = []

    def work() -> None:
        found.extend(number for _, number in spread(own_number, [()] * 2, jobs=2))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    time.sleep(0.5)
    assert all(Path(f"/proc/{number}").exists() for number in found)
