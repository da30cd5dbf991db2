"""The gates of the judged band: is there more torque than noise, and does a finding close the gap on held-out data?

The judged band holds the frequencies, from zero to a cutoff, in which the found effects are tested once more. The gap
is the squared residual of the model after changes within its tolerances. The share of the gap that a finding closes is
the decrease of the squared residual by the finding.
"""

from __future__ import annotations

from identification.engine.claims import GateResult

# share: a finding may enlarge the gap in a bootstrap draw by at most this share of the part of the gap that it closes
# on average. For example, if a joint moves in one block only, a finding closes nothing in a draw without that block,
# and noise in the other blocks enlarges the gap a little.
OPENED_AGAIN = 0.1


def torque_is_there(torque: float) -> GateResult:
    """Is the measured torque of some joint above its noise?

    Every recording in which the drives do work passes.

    Args:
        torque: The measured torque of a joint, divided by the upper end of the interval of its noise floor; the
            largest over all joints.
    """
    return GateResult("torque is there", torque, 1.0, "floors", torque > 1.0)


def closes_for_sure(least: float) -> GateResult:
    """Does the finding close the gap on held-out data in nearly every bootstrap draw of the blocks?

    If not, the effect may only explain noise in a few blocks that have most of the gap. A true finding would pass with
    more recordings.

    Args:
        least: Closed share of the gap at the lower end of its bootstrap interval, divided by the closed share itself.
    """
    return GateResult("closes for sure", least, -OPENED_AGAIN, "of what it closes", least >= -OPENED_AGAIN)
