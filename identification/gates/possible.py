"""The gate of possible sizes: are all sizes of a fit inside the range of their law?"""

from __future__ import annotations

from identification.engine.claims import GateResult


def possible_size(impossible: int) -> GateResult:
    """Are all sizes of the fit inside the range of their law, and none at its bound?

    Args:
        impossible: Number of effects of the fit whose size is at a bound where they make no torque.
    """
    return GateResult("possible size", float(impossible == 0), 0.0, "possible", impossible == 0)
