"""The gates of the judged band: is there a torque, a gap, and is the effect visible in it?

Extra findings and lost second effects in `benchmarks/blind/run.py` show what their thresholds do.
"""

from __future__ import annotations

from identification.engine.claims import GateResult

# share: by which the squared residual of some joint grows without the finding.
VISIBLE_GROWTH = 0.03
# share: of what a finding closes, which it may open again in some draw of the blocks. Where a joint moves once, a draw
# without that block closes nothing, and what noise does elsewhere is less than this.
OPENED_AGAIN = 0.1


def torque_is_there(torque: float) -> GateResult:
    """Is more measured than noise on some joint, so that the torque says anything of the robot?

    A recording in which the drives work passes.

    Args:
        torque: The largest measured torque of a joint, in upper ends of its noise floor.
    """
    return GateResult("torque is there", torque, 1.0, "floors", torque > 1.0)


def gap_is_there(growth: float) -> GateResult:
    """Does the given model leave more than noise on some joint, so that there is anything to explain?

    A larger gap passes, or a quieter recording.

    Args:
        growth: The largest squared residual of a joint over the square of its noise, less one.
    """
    return GateResult("gap is there", growth, VISIBLE_GROWTH, "of the squared noise", growth > VISIBLE_GROWTH)


def visible(growth: float) -> GateResult:
    """Does the residual of some joint grow without it in the judged band, and that of the mean joint not shrink?

    A stronger effect passes; one that is significant above the judged band alone is of no use.

    Args:
        growth: Relative growth of the squared residual where it is largest; minus one if the others shrink more.
    """
    return GateResult("visible", growth, VISIBLE_GROWTH, "of the squared residual", growth >= VISIBLE_GROWTH)


def closes_for_sure(least: float) -> GateResult:
    """Does it not open the gap on held-out data, whichever blocks of them count?

    What fits need may be noise of the few blocks that hold most of the gap. More recordings settle it.

    Args:
        least: Lower end of the interval of what it closes, over what it closes.
    """
    return GateResult("closes for sure", least, -OPENED_AGAIN, "of what it closes", least >= -OPENED_AGAIN)
