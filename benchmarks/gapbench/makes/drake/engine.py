"""Drake, from a folder of its own: it is too large to be a dependency of what it tests."""

from __future__ import annotations

import importlib
import importlib.util
import os
import sys
from pathlib import Path
from typing import Any

CHECKOUT = Path(__file__).resolve().parents[4]
FOLDER = Path(os.environ.get("DRAKE_FOLDER", CHECKOUT / ".venv-drake"))


def installed() -> bool:
    """Whether Drake lies in its folder or in this environment."""
    return (FOLDER / "pydrake").is_dir() or importlib.util.find_spec("pydrake") is not None


def drake(module: str) -> Any:
    """A module of Drake by its name behind ``pydrake.``; without types, as it need not be installed."""
    # At the end of the path: what Drake brings must not stand in for what the environment has.
    if FOLDER.is_dir() and str(FOLDER) not in sys.path:
        sys.path.append(str(FOLDER))
    try:
        return importlib.import_module(f"pydrake.{module}")
    except ModuleNotFoundError as error:
        wanted = "pip install 'gapbench[drake]', or 'make drake' in a checkout of phantom-dyn"
        raise SystemExit(f"Drake is not installed: {wanted}.") from error
