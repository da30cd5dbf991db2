"""The gate of size: a claim that passes is a finding; a claim that fails is listed as minor (too small to matter)."""

from __future__ import annotations

from identification.engine import contract_levels
from identification.engine.claims import GateResult, easiest_test


def large_enough(gap_closed: float, floors: float) -> GateResult:
    """Does the finding close a hundredth of the gap, or lower the residual of some joint by half a noise floor?

    A stronger effect would pass. An effect that fails would hardly matter in a simulation of the robot.

    Args:
        gap_closed: Share of the gap (the squared residual of the model) that the finding closes.
        floors: Increase of a joint's residual without the finding, in noise floors; the largest over all joints.
    """
    ways = (
        (gap_closed, contract_levels.MINOR_SHARE, "of the gap"),
        (floors, contract_levels.MINOR_FLOORS, "floors"),
    )
    return easiest_test("large enough", ways)
