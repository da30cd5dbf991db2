"""The gate of recordings without a torque: positions do not separate a torque constant from its controller's gain."""

from __future__ import annotations

import numpy as np

from identification.engine.claims import GateResult

# relative, one sigma: how well stated gains are trusted; twice that is no gap.
GAIN_TOLERANCE = 0.10


def beyond_the_gain(excess: float, *, stated: bool) -> GateResult:
    """Is it more than what the gain of the controller, which acts alike, may be wrong by?

    A measured torque or current passes, and a gain that is stated.

    Args:
        excess: Relative size beside the gain; not finite where it is taken up whole.
        stated: False if the gain was estimated from the same positions, and has taken up what there is.
    """
    needed = 2.0 * GAIN_TOLERANCE if stated else np.inf
    return GateResult("beyond the gain", abs(excess), needed, "relative", stated and abs(excess) > needed)
