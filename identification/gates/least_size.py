"""The gate of size: what passes is a finding, what does not is listed as minor."""

from __future__ import annotations

from identification.engine import contract_levels
from identification.engine.claims import GateResult, easiest


def large_enough(gap_closed: float, floors: float) -> GateResult:
    """Does it close a hundredth of the gap, or half a noise floor of some joint?

    A stronger effect passes; of what does not, a simulation of the robot would show next to nothing.

    Args:
        gap_closed: Share of the gap that comes back without it.
        floors: By which the residual of some joint grows at most without it, in noise floors.
    """
    ways = (
        (gap_closed, contract_levels.MINOR_SHARE, "of the gap"),
        (floors, contract_levels.MINOR_FLOORS, "floors"),
    )
    return easiest("large enough", ways)
