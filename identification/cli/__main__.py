"""Entry point of the command ``phantom-dyn``, which is also ``python -m identification.cli``."""

from __future__ import annotations

import os
import sys


def started() -> int:
    """Run the command and return its exit code: 130 if Ctrl-C comes, even before the command is loaded."""
    try:
        # Without this, MuJoCo, which checks corrected models, would load a graphics library.
        os.environ.setdefault("MUJOCO_GL", "disable")
        from identification.cli.main import main
    except KeyboardInterrupt:
        print("phantom-dyn: interrupted", file=sys.stderr)
        return 130
    return main()


if __name__ == "__main__":
    sys.exit(started())
