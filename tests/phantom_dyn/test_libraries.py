"""What importing the package loads, what its first call compiles, and its types.

Pieces of large work over processes and threads. Oracles: the same calls one after the other; threadpoolctl.
"""

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import cloudpickle
import numpy
import numpy as np
import pytest
from joblib import parallel_config
from joblib.externals.loky import get_reusable_executor
from threadpoolctl import threadpool_info, threadpool_limits

import phantom_dyn as dyn
from phantom_dyn import libraries, load_robot
from phantom_dyn._kernels.regressor_loop import regressor_loop
from phantom_dyn._kernels.rigid_body_loops import frame_loop, mass_loop, torque_loop
from phantom_dyn.array_types import Bool, Complex, Float, Int, read_only
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.errors import ParameterError, UsageError
from phantom_dyn.large_work import WorkerLostError, spread, starts_processes, worker_count
from phantom_dyn.libraries import is_installed, missing_library, optional_library
from phantom_dyn.motion import Motion, side_by_side


@pytest.mark.parametrize(("kind", "dtype"), [(Bool, bool), (Complex, complex), (Float, float), (Int, int)])
def test_a_type_holds_arrays_of_its_numbers_and_shape_alone(kind, dtype):
    # Oracle: jaxtyping's own check, which conftest has loaded.
    other = float if dtype is int else int
    wanted = kind[np.ndarray, "2 nv"]
    assert isinstance(np.zeros((2, 3), dtype), wanted)
    assert not isinstance(np.zeros((3, 3), dtype), wanted)
    assert not isinstance(np.zeros((2, 3), other), wanted)


def test_the_whole_line_runs_without_loading_jaxtyping():
    code = "import sys, identification.pipeline; print('jaxtyping' in sys.modules, 'pinocchio' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "True"]


HEAVY = {"numpy", "scipy", "matplotlib", "pinocchio", "numba", "pandas", "xarray", "plotly", "identification"}


def test_the_door_offers_what_it_documents():
    functions = {"load_robot", "read_recording", "diagnose", "identify", "excite", "check", "compare", "simulate"}
    assert functions | {"map_workspace", "Diagnosis", "PhantomDynError", "__version__"} == set(dyn.__all__)
    assert dyn.__doc__ is not None
    assert all(name in dyn.__doc__ for name in functions)


@pytest.mark.parametrize("name", [name for name in dyn.__all__ if name != "__version__"])
def test_every_name_exists_and_says_what_it_does(name):
    assert getattr(dyn, name).__name__ == name
    assert getattr(dyn, name).__doc__


def test_tab_completion_shows_the_names_of_the_entrance():
    assert dir(dyn) == sorted(dyn.__all__)


def test_a_name_that_there_is_not_lists_those_that_there_are():
    with pytest.raises(AttributeError, match=r"no attribute 'diagnosis_of', it offers Diagnosis, .*simulate"):
        _ = dyn.diagnosis_of


def test_the_import_loads_nothing_heavy():
    script = f"import phantom_dyn as dyn, sys; dir(dyn); print(*sorted(set(sys.modules) & {HEAVY!r}))"
    child = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert child.stdout.split() == []


def test_loading_a_robot_loads_nothing_of_recordings():
    script = "import phantom_dyn as dyn, sys; dyn.load_robot('emps'); print('identification' in sys.modules)"
    child = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert child.stdout.split() == ["False"]


def test_a_missing_library_is_named_with_the_command_that_installs_it():
    assert missing_library("rosbags") == (
        "Reading a ROS bag or MCAP needs rosbags, which is not installed: pip install 'phantom-dyn[ros]'."
    )


def test_what_can_be_imported_is_installed():
    assert (is_installed("numpy"), is_installed("no_such_library")) == (True, False)


def test_an_optional_library_is_the_module_itself():
    assert optional_library("numpy") is numpy


def test_an_optional_library_that_is_missing_is_refused_in_that_sentence(monkeypatch):
    monkeypatch.setattr(libraries, "is_installed", lambda _: False)
    with pytest.raises(UsageError, match=r"A table of findings.* needs pandas.* 'phantom-dyn\[tables\]'"):
        optional_library("pandas")


def test_an_array_that_may_be_written_to_is_copied(rng):
    given = rng.normal(size=(5, 2))
    kept = read_only(given)
    before = given.copy()
    given[:] = 0.0
    np.testing.assert_array_equal(kept, before)
    with pytest.raises(ValueError, match="read-only"):
        kept[0, 0] = 1.0


def test_a_copy_that_nobody_can_write_to_is_not_copied_again(rng):
    kept = read_only(rng.normal(size=(5, 2)))
    assert read_only(kept) is kept


def test_a_view_of_what_may_be_written_to_is_copied(rng):
    given = rng.normal(size=5)
    view = given[:]
    view.flags.writeable = False
    assert not np.shares_memory(read_only(view), given)


@pytest.mark.parametrize("count", [1, 4095, 4096, 10000])
def test_columns_side_by_side_are_those_of_numpy(rng, count):
    columns = list(rng.normal(size=(3, count)))
    found = side_by_side(columns)
    np.testing.assert_array_equal(found, np.column_stack(columns))
    assert read_only(found) is found


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


def test_the_number_of_workers_is_what_joblib_was_given():
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
    assert loop.compiled.targetoptions["nogil"] is True


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
