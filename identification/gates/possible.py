"""The gate of sizes that exist."""

from __future__ import annotations

from identification.engine.claims import GateResult


def possible_size(impossible: int) -> GateResult:
    """Do all sizes of the fit exist, none at the very end of what its law may be?

    A fit with another sign passes, or one that stays off the bound.

    Args:
        impossible: Effects of the fit that end on nothing.
    """
    return GateResult("possible size", float(impossible == 0), 0.0, "possible", impossible == 0)
