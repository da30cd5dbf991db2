"""The gates of the judged band: is there a torque in it, and is the gap closed on whatever is held out of it?"""

from __future__ import annotations

from identification.engine.claims import GateResult

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


def closes_for_sure(least: float) -> GateResult:
    """Does it not open the gap on held-out data, whichever blocks of them count?

    What fits need may be noise of the few blocks that hold most of the gap. More recordings settle it.

    Args:
        least: Lower end of the interval of what it closes, over what it closes.
    """
    return GateResult("closes for sure", least, -OPENED_AGAIN, "of what it closes", least >= -OPENED_AGAIN)
