"""``python -m identification.cli`` is the command ``phantom-dyn``; both begin here."""

from __future__ import annotations

import gc
import os
import sys

# Between two rounds of the cyclic garbage collector, of which Python has 700 by default: while half a million objects
# of libraries load, rounds that find nothing are a tenth of the time. Arrays go with their last name, without it.
_NEW_OBJECTS = 100_000


def started() -> int:
    """Run the command, and return its exit code: 130 where Ctrl-C comes before it is loaded, too."""
    try:
        gc.set_threshold(_NEW_OBJECTS)
        # MuJoCo, asked to check a corrected model, would load a library for windows.
        os.environ.setdefault("MUJOCO_GL", "disable")
        from identification.cli.main import main
    except KeyboardInterrupt:
        print("phantom-dyn: interrupted", file=sys.stderr)
        return 130
    return main()


if __name__ == "__main__":
    sys.exit(started())
