"""``python -m identification.cli`` is the command ``phantom-dyn``; both begin here."""

from __future__ import annotations

import sys


def started() -> int:
    """Run the command, and return its exit code: 130 where Ctrl-C comes before it is loaded, too."""
    try:
        from identification.cli.main import main
    except KeyboardInterrupt:
        print("phantom-dyn: interrupted", file=sys.stderr)
        return 130
    return main()


if __name__ == "__main__":
    sys.exit(started())
