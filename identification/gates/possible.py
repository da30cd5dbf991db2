"""The gate of possible sizes: can all sizes that a fit gives to its effects exist?"""

from __future__ import annotations

from identification.engine.claims import GateResult


def possible_size(impossible: int) -> GateResult:
    """Are all sizes of the fit possible, such as friction that is not negative?

    A fit limits each size to its possible range. If the data need an impossible size, the fit puts the size at a bound
    where the effect makes no torque.

    Args:
        impossible: Number of effects of the fit with a size at such a bound.
    """
    return GateResult("possible size", float(impossible == 0), 0.0, "possible", impossible == 0)
