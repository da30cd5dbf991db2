"""The gates of the judged band: is there more torque than noise, and does a finding close the gap on held-out data?"""

from __future__ import annotations

from identification.engine.claims import GateResult

# share: of what a finding closes, by which it may enlarge the gap in some draws of the blocks. Where a joint moves
# once, a draw without that block closes nothing, and noise in the others enlarges the gap by less than this.
OPENED_AGAIN = 0.1


def torque_is_there(torque: float) -> GateResult:
    """Is the measured torque of some joint above its noise?

    A recording in which the drives work passes.

    Args:
        torque: The largest measured torque of a joint, in units of the upper end of its noise floor.
    """
    return GateResult("torque is there", torque, 1.0, "floors", torque > 1.0)


def closes_for_sure(least: float) -> GateResult:
    """Does it close the gap on held-out data in nearly every draw of the blocks?

    A fit may need it only for noise in the few blocks that hold most of the gap. More recordings decide that.

    Args:
        least: Lower end of the interval of what it closes, over what it closes.
    """
    return GateResult("closes for sure", least, -OPENED_AGAIN, "of what it closes", least >= -OPENED_AGAIN)
