"""``python -m identification.cli`` is the command ``phantom-dyn``."""

from __future__ import annotations

import sys

from identification.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
