"""The gates of size: what passes them is a finding, what does not is listed as minor."""

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


def closes_for_sure(least: float) -> GateResult:
    """Does it close some of the gap on held-out data, whichever blocks of them count?

    What fits need may be noise of the few blocks that hold most of the gap.

    Args:
        least: Lower end of the interval of the gap that it closes.
    """
    return GateResult("closes for sure", least, 0.0, "of the gap", least > 0.0)
