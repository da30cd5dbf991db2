"""The gate of possible sizes: is no effect of a fit at the end of its range?"""

from __future__ import annotations

from identification.engine.claims import GateResult


def possible_size(impossible: int) -> GateResult:
    """Are all sizes of the fit inside the range of their law, and none at its bound?

    Args:
        impossible: Effects of the fit whose size is at a bound, where they vanish.
    """
    return GateResult("possible size", float(impossible == 0), 0.0, "possible", impossible == 0)
