"""Makes of sealed cases by name: those of `gapbench`, and ``real``, which adds effects to real recordings."""

from __future__ import annotations

from benchmarks.gapbench import makes
from benchmarks.gapbench.makes import Make, make_of

REAL = "benchmarks.blind.makes.real.case"
NAMES = (*makes.NAMES, "real")
ALONE = ("real",)  # cases that baselines and oracle cannot read: several logs, and a model with effects


def make_named(name: str) -> Make:
    """The make with a name of `NAMES`."""
    return make_of(REAL) if name == "real" else makes.make_named(name)
