"""The gate of recordings without a torque: is an effect larger than the uncertainty of the controller's gain?

From positions alone a wrong torque constant cannot be distinguished from a wrong gain of the joint's controller.
"""

from __future__ import annotations

import numpy as np

from identification.engine.claims import GateResult

# relative, one sigma: accuracy of stated gains. An effect of less than two sigma is no gap.
GAIN_TOLERANCE = 0.10


def beyond_the_gain(excess: float, *, stated: bool) -> GateResult:
    """Is the effect larger than the uncertainty of the controller's gain?

    A wrong gain changes the positions in the same way as the effect. The effect would pass in a recording with a
    measured torque or current, or with a controller whose gain is stated.

    Args:
        excess: Size of the effect relative to the gain; infinite if the gain is zero.
        stated: False if the gain was estimated from the same positions, so that a wrong gain explains the effect, too.
    """
    needed = 2.0 * GAIN_TOLERANCE if stated else np.inf
    return GateResult("beyond the gain", abs(excess), needed, "relative", stated and abs(excess) > needed)
