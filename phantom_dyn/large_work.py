"""Runs large pieces of work in parallel with joblib: in processes by default, or on Dask, Ray or threads.

The backend is chosen by joblib's settings::

    from joblib import parallel_config

    with parallel_config(backend="dask"):           # with a dask.distributed.Client, for example
        operational_map(model, grid, names)         # the same call, on the cluster

Every piece runs with one thread of linear algebra, because matrices are small and results must not depend on the number
of threads. joblib is imported only where it is used, because its import takes longer than most commands.
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

# Largest number of pools of processes that are started one after the other, as many as attempts of Dask's scheduler.
_ATTEMPTS = 3
# Period with which a worker checks whether the process that started it is still running [s].
_WATCH_PERIOD_S = 0.2
# PR_SET_PDEATHSIG of Linux: the kernel signals a process when the thread that started it ends.
_END_WITH_PARENT = 1
# Names of the errors for a lost worker; not their classes, because joblib's are not public and Dask may be missing.
_LOST = ("TerminatedWorkerError", "BrokenProcessPool", "KilledWorker")


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
    """Number of pieces that are computed at the same time.

    Args:
        jobs: Largest number of processes; 1 for this process only. By default that of `joblib.parallel_config`, or one
            per core that this process may use; on Dask always the number of threads of the cluster's workers.

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
    """True if workers are processes that have to be started, which takes a second; False on Dask and in threads."""
    return type(_backend()[0]).__name__ in ("LokyBackend", "MultiprocessingBackend")


def _backend() -> tuple[Any, int | None]:
    """Settings of `joblib.parallel_config`: the backend, and the number of jobs or None."""
    from joblib.parallel import get_active_backend

    return cast("tuple[Any, int | None]", get_active_backend())


def spread(
    function: Callable[..., R], pieces: Iterable[tuple[Any, ...]], *, jobs: int | None = None
) -> Iterator[tuple[int, R]]:
    """Results of a function for many arguments, each with the index of its piece, in the order of completion.

    If a process is lost (killed, out of memory), its unfinished pieces are run again: on Dask by the scheduler,
    otherwise in half as many new processes.

    Args:
        function: Function of a module, because it is sent by name. It must depend on its arguments only.
        pieces: Arguments of each call. They are sent with each piece, so they should be small.
        jobs: Number of processes, see `worker_count`.

    Raises:
        WorkerLostError: If processes are lost repeatedly.
        ParameterError: If ``jobs`` is below one.
    """
    unfinished = dict(enumerate(pieces))
    workers = min(worker_count(jobs), len(unfinished))
    # The number of threads is a setting of the process. It is set here because, if workers are threads, the first of
    # them to finish would reset it.
    with threadpool_limits(limits=1):
        yield from _spread(function, unfinished, workers)


def _spread(
    function: Callable[..., R], unfinished: dict[int, tuple[Any, ...]], workers: int
) -> Iterator[tuple[int, R]]:
    """Results of the pieces in ``unfinished``, from which finished pieces are removed."""
    if workers <= 1:
        yield from (_run((function, index, arguments)) for index, arguments in unfinished.items())
        return
    for attempt in range(_ATTEMPTS):
        try:
            for index, result in _finished(function, unfinished, max(2, workers >> attempt)):
                del unfinished[index]
                yield index, result
            return
        except Exception as error:
            if type(error).__name__ not in _LOST:
                raise
    raise WorkerLostError(tuple(unfinished))


def _finished(
    function: Callable[..., R], unfinished: dict[int, tuple[Any, ...]], workers: int
) -> Iterable[tuple[int, R]]:
    """Results of the pieces in ``unfinished``, computed by one pool of workers."""
    from joblib import Parallel, delayed

    # Ray and multiprocessing return results only when all pieces are finished.
    return_as = "generator_unordered" if _backend()[0].supports_return_generator else "list"
    # Workers of loky would continue for minutes after the process that started them was killed.
    watched = type(_backend()[0]).__name__ == "LokyBackend"
    # The kernel watches the calling thread; another thread than the main one may end long before the process.
    by_kernel = threading.current_thread() is threading.main_thread()
    ending: dict[str, Any] = {"initializer": end_with, "initargs": (os.getpid(), by_kernel)} if watched else {}
    # One piece per call, because pieces are large; arrays are sent and not shared through files.
    one_each: dict[str, Any] = {"pre_dispatch": "2*n_jobs", "batch_size": 1, "max_nbytes": None}
    parallel = Parallel(n_jobs=workers, return_as=return_as, **one_each, **ending)
    # All arguments are one tuple, which is sent with its piece. An array as an argument of its own would be stored by
    # one worker of Dask, and all pieces that need the array would be lost with this worker.
    calls = [delayed(_run)((function, index, arguments)) for index, arguments in unfinished.items()]
    return cast("Iterable[tuple[int, R]]", parallel(calls))


def end_with(parent: int, by_kernel: bool) -> None:
    """End this worker process as soon as the process that started it has ended, even if that process was killed.

    On Linux the kernel ends the worker at once. On other systems a thread of the worker checks the parent; it may be
    delayed by the interpreter lock or on a busy machine.

    Args:
        parent: Identifier of the process that started this one.
        by_kernel: True if the main thread of the parent starts the workers, which the kernel can then watch.
    """
    if by_kernel and (control := getattr(ctypes.CDLL(None), "prctl", None)) is not None:
        control(_END_WITH_PARENT, signal.SIGKILL, 0, 0, 0)
    # This thread is for other systems, and for a parent that ended before the call of ``prctl``.
    threading.Thread(target=_watch, args=(parent,), daemon=True).start()


def _watch(parent: int) -> None:
    """Wait until the parent has ended, then end this process."""
    while os.getppid() == parent:
        time.sleep(_WATCH_PERIOD_S)
    os._exit(1)


def _run(piece: tuple[Callable[..., R], int, tuple[Any, ...]]) -> tuple[int, R]:
    """Index and result of one piece, computed with one thread of linear algebra."""
    function, index, arguments = piece
    with threadpool_limits(limits=1):
        return index, function(*arguments)
