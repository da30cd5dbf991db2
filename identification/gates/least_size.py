"""The gate of size: a claim that passes is a finding, one that does not is listed as minor."""

from __future__ import annotations

from identification.engine import contract_levels
from identification.engine.claims import GateResult, easiest


def large_enough(gap_closed: float, floors: float) -> GateResult:
    """Does the finding close a hundredth of the gap, or half a noise floor of some joint?

    A stronger effect would pass. One that fails would hardly show in a simulation of the robot.

    Args:
        gap_closed: Share of the gap that is open without it.
        floors: Largest growth of a joint's residual without it, in noise floors.
    """
    ways = (
        (gap_closed, contract_levels.MINOR_SHARE, "of the gap"),
        (floors, contract_levels.MINOR_FLOORS, "floors"),
    )
    return easiest("large enough", ways)
