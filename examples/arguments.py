"""The one argument that several examples take: the folder that they write into."""

from __future__ import annotations

import argparse
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parents[1]


def chosen_folder(description: str | None, name: str) -> Path:
    """The folder that the command line names, by default ``demo/NAME`` in the checkout."""
    default = CHECKOUT / "demo" / name
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, nargs="?", default=default, metavar="FOLDER", help=f"default: demo/{name}")
    return parser.parse_args().folder
