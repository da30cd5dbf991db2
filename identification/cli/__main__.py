"""Starts the command ``phantom-dyn``, also as ``python -m identification.cli``."""

from __future__ import annotations

import os
import sys


def started() -> int:
    """Run the command and return its exit code: 130 after Ctrl-C, even while the command is being loaded."""
    try:
        # MuJoCo checks corrected models. Without this setting, it would load a graphics library.
        os.environ.setdefault("MUJOCO_GL", "disable")
        from identification.cli.main import main
    except KeyboardInterrupt:
        print("phantom-dyn: interrupted", file=sys.stderr)
        return 130
    return main()


if __name__ == "__main__":
    sys.exit(started())
