"""``python -m identification.cli`` is the command ``phantom-dyn``; both begin here."""

from __future__ import annotations

import atexit
import gc
import os
import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import LazyLoader
from types import ModuleType

# Between two rounds of the cyclic garbage collector, of which Python has 700 by default: while half a million objects
# of libraries load, rounds that find nothing are a tenth of the time. Arrays go with their last name, without it.
_NEW_OBJECTS = 1_000_000
# SciPy asks NumPy for all its parts by name when it loads, and no command uses these.
_UNUSED = {"numpy.f2py", "numpy.testing"}


class _LoadedWhenUsed:
    """Finds modules that are not loaded when they are imported, but when something in them is asked for."""

    @staticmethod
    def find_spec(name: str, path: Sequence[str] | None = None, target: ModuleType | None = None) -> ModuleSpec | None:
        """What to load, as the finders of `sys.meta_path` say it; None for all other modules."""
        spec = PathFinder.find_spec(name, path, target) if name in _UNUSED else None
        if spec is not None and spec.loader is not None:
            spec.loader = LazyLoader(spec.loader)
        return spec


def started() -> int:
    """Run the command, and return its exit code: 130 where Ctrl-C comes before it is loaded, too."""
    done: list[int] = []
    atexit.register(_end, done)  # what is registered first is called last
    try:
        gc.set_threshold(_NEW_OBJECTS)
        sys.meta_path.insert(0, _LoadedWhenUsed)
        # MuJoCo, asked to check a corrected model, would load a library for windows.
        os.environ.setdefault("MUJOCO_GL", "disable")
        from identification.cli.main import main
    except KeyboardInterrupt:
        print("phantom-dyn: interrupted", file=sys.stderr)
        return 130
    done.append(main())
    return done[0]


def _end(done: list[int]) -> None:
    """End the process where a command is done, with its exit code and without taking all objects apart.

    Python frees them one by one at its end, which takes a tenth of the time of a small command. Threads have ended by
    now, and what libraries leave to do at the end is done.
    """
    if not done:
        return
    try:
        sys.stdout.flush()
        sys.stderr.flush()
    except (OSError, ValueError):
        return  # Python says what is wrong with a stream
    os._exit(done[0])


if __name__ == "__main__":
    sys.exit(started())
