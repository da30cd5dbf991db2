"""Makes of cases: independent generators of one form of case and answer, chosen by name."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

# Imported when they are asked for: a make must run where what another one is built on is missing.
MODULES = {
    "mujoco": "..generator.case",
    "drake": ".drake.case",
    "field": ".field.case",
    "slow": ".slow",
}
NAMES = tuple(MODULES)
EXTRAS = {"drake": ("pydrake",), "field": ("numba", "pyarrow")}  # packages that only one make needs


# Of an effect: what the tolerance has to leave of it, as a share or in noise floors, whichever is less.
SHARE_BEYOND, FLOORS_BEYOND = 0.5, 2.0


def enough_beyond(size: float, beyond: float) -> bool:
    """Whether the tolerance of the model leaves enough of an effect to ask for it [noise floors, both]."""
    return beyond >= min(SHARE_BEYOND * size, FLOORS_BEYOND)


class NoCase(Exception):
    """A seed and a kind that give no possible case."""


class MissingPackage(Exception):
    """A case that needs a package that is not installed; the sentence says which."""


@dataclass(frozen=True)
class Make:
    """What every make offers.

    Attributes:
        case_id: Name of the case of a seed and a kind.
        resolved_kind: ``mixed`` made ``null`` or ``single``.
        draw_case: The case, with its ``answer``; raises `NoCase` where a seed gives none.
        write_case: Writes what the diagnosis may see.
    """

    case_id: Callable[[int, str], str]
    resolved_kind: Callable[[int, str], str]
    draw_case: Callable[[int, str], Any]
    write_case: Callable[[Any, Path], Path]


def make_of(module: str) -> Make:
    """The make that a module offers; a name with a leading dot is relative to this package."""
    found = importlib.import_module(module, __name__)
    return Make(found.case_id, found.resolved_kind, found.draw_case, found.write_case)


def missing(name: str) -> str:
    """One sentence if a make cannot run in this environment, else an empty text."""
    if name == "drake" and importlib.import_module(".drake.engine", __name__).installed():
        return ""  # it may lie in a folder of its own
    lacks = [package for package in EXTRAS.get(name, ()) if importlib.util.find_spec(package) is None]
    if not lacks:
        return ""
    return f"Cases of the make {name} are left out: pip install 'gapbench[{name}]' brings {' and '.join(lacks)}."


def make_named(name: str) -> Make:
    """The make of a name of `NAMES`."""
    return make_of(MODULES[name])
