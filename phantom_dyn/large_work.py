"""Parallel work on large pieces with joblib: in processes by default, else on Dask, Ray or threads by its backends.

    from joblib import parallel_config

    with parallel_config(backend="dask"):           # with a dask.distributed.Client, for example
        operational_map(model, grid, names)         # the same call, on the cluster

Every piece runs with one thread of linear algebra: matrices are small here, and results do not depend on the number of
threads. joblib is imported where it is used: it takes longer to import than most commands run.
"""

from __future__ import annotations

import ctypes
import os
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, TypeVar, cast

from threadpoolctl import threadpool_limits

from phantom_dyn.errors import ParameterError, PhantomDynError

R = TypeVar("R")

_ATTEMPTS = 3
"""Pools of processes that are started before the work is given up; Dask's scheduler tries as often."""
_WATCH_PERIOD_S = 0.2
"""Time between two checks of a worker whether the process that started it still runs [s]."""
_END_WITH_PARENT = 1  # PR_SET_PDEATHSIG of Linux: the kernel signals a process when the thread that started it ends
_LOST = ("TerminatedWorkerError", "BrokenProcessPool", "KilledWorker")
"""Names of the errors of a lost worker: joblib's own are not public, and Dask may not be installed."""


class WorkerLostError(PhantomDynError):
    """Worker processes ended repeatedly before all pieces were done.

    Attributes:
        left: Indices of the pieces that are not done.
    """

    def __init__(self, left: Sequence[int]):
        super().__init__(
            f"{len(left)} pieces of the work are not done, as the processes that worked on them ended {_ATTEMPTS} "
            "times, perhaps because memory ran out: work with fewer processes."
        )
        self.left = tuple(left)


def worker_count(jobs: int | None) -> int:
    """Number of pieces that are worked on at once.

    Args:
        jobs: Processes at most; 1 is this one alone. By default what `joblib.parallel_config` says, else one per core
            that this process may use; on Dask always the threads of the cluster's workers.

    Raises:
        ParameterError: If the number is below one.
    """
    if jobs is not None and jobs < 1:
        raise ParameterError(f"jobs = {jobs} was given, wanted a number of processes from 1 on, or None")
    if jobs == 1:
        return 1
    from joblib import effective_n_jobs

    chosen = _backend()[1] if jobs is None else jobs
    return effective_n_jobs(-1 if chosen is None else chosen)


def starts_processes() -> bool:
    """True where workers are processes that must be started first, which takes a second; False on Dask, in threads."""
    return type(_backend()[0]).__name__ in ("LokyBackend", "MultiprocessingBackend")


def _backend() -> tuple[Any, int | None]:
    """Settings of `joblib.parallel_config`: the backend, and the number of jobs or None."""
    from joblib.parallel import get_active_backend

    return cast("tuple[Any, int | None]", get_active_backend())


def spread(
    function: Callable[..., R], pieces: Iterable[tuple[Any, ...]], *, jobs: int | None = None
) -> Iterator[tuple[int, R]]:
    """Results of a function for many arguments, each with the index of its piece, in the order of completion.

    If a process is lost (killed, out of memory), its unfinished pieces are run again: on Dask by the scheduler, else in
    new processes, half as many.

    Args:
        function: Function of a module, as it is sent by name. It must depend on its arguments alone.
        pieces: Arguments of each call. They are sent with each piece: keep them small.
        jobs: Processes at once; None: one for each core that this process may use.

    Raises:
        WorkerLostError: If processes are lost repeatedly.
        ParameterError: If ``jobs`` is below one.
    """
    left = dict(enumerate(pieces))
    workers = min(worker_count(jobs), len(left))
    # The number of threads belongs to a whole process. Where workers are threads of this one, it is set here, as the
    # first of them to end would give back what it found.
    with threadpool_limits(limits=1):
        yield from _spread(function, left, workers)


def _spread(function: Callable[..., R], left: dict[int, tuple[Any, ...]], workers: int) -> Iterator[tuple[int, R]]:
    """Results of the pieces in ``left``, which are taken out of it when they are handed over."""
    if workers <= 1:
        yield from (_run((function, index, arguments)) for index, arguments in left.items())
        return
    for attempt in range(_ATTEMPTS):
        try:
            for index, result in _finished(function, left, max(2, workers >> attempt)):
                del left[index]
                yield index, result
            return
        except Exception as error:
            if type(error).__name__ not in _LOST:
                raise
    raise WorkerLostError(tuple(left))


def _finished(function: Callable[..., R], left: dict[int, tuple[Any, ...]], workers: int) -> Iterable[tuple[int, R]]:
    """Results of the pieces in ``left``, computed by one pool of workers."""
    from joblib import Parallel, delayed

    # Ray and multiprocessing return results only when all are finished.
    return_as = "generator_unordered" if _backend()[0].supports_return_generator else "list"
    # Workers of loky run on for minutes after the process that started them was killed.
    watched = type(_backend()[0]).__name__ == "LokyBackend"
    # A thread of the user may end long before the process, whose next call uses the same workers.
    by_kernel = threading.current_thread() is threading.main_thread()
    ending: dict[str, Any] = {"initializer": end_with, "initargs": (os.getpid(), by_kernel)} if watched else {}
    # One piece per call, as pieces are large; arrays are sent and not shared through files.
    one_each: dict[str, Any] = {"pre_dispatch": "2*n_jobs", "batch_size": 1, "max_nbytes": None}
    parallel = Parallel(n_jobs=workers, return_as=return_as, **one_each, **ending)
    # One tuple, which travels with its piece. Of an array that is an argument itself joblib leaves one copy with one of
    # Dask's workers, and all pieces that need it would be lost with that worker.
    calls = [delayed(_run)((function, index, arguments)) for index, arguments in left.items()]
    return cast("Iterable[tuple[int, R]]", parallel(calls))


def end_with(parent: int, by_kernel: bool) -> None:
    """End this worker process as soon as the process that started it has ended, even if that was killed.

    On Linux the kernel does so at once. A thread that checks has to wait for the interpreter lock, which compiled code
    may hold, and for its turn on a busy machine.

    Args:
        parent: Identifier of the process that started it.
        by_kernel: Whether its main thread starts the workers: the kernel watches the thread and not the process.
    """
    if by_kernel and (control := getattr(ctypes.CDLL(None), "prctl", None)) is not None:
        control(_END_WITH_PARENT, signal.SIGKILL, 0, 0, 0)
    # On other systems, and for a parent that ended before the kernel was asked.
    threading.Thread(target=_watch, args=(parent,), daemon=True).start()


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_WATCH_PERIOD_S)
    os._exit(1)


def _run(piece: tuple[Callable[..., R], int, tuple[Any, ...]]) -> tuple[int, R]:
    """Index and result of one piece, computed with one thread of linear algebra."""
    function, index, arguments = piece
    with threadpool_limits(limits=1):
        return index, function(*arguments)
