"""The gate of chance: is a gain larger than noise gives? Gains are twice a log-likelihood ratio.

``benchmarks/blind/run.py`` prints false claims and misses under its thresholds, ``benchmarks/blind/power.py`` the sizes
that are seen.
"""

from __future__ import annotations

from identification.engine.claims import GateResult

# probability: that in a recording without a gap no effect of the catalogue reaches the threshold by chance.
CLAIM_LEVEL = 0.99

# gain: the least that a claim needs on held-out data, however little chance gives.
LEAST_GAIN = 20.0

# gain: of one parameter, about the logarithm of the effective number of samples (BIC).
PARAMETER_PRICE = 5.0


def more_than_chance(gain: float, chance: float) -> GateResult:
    """Does it gain more than the best effect of the whole catalogue, or of its joint, gains by chance?

    A longer recording passes: the gain of a real effect grows with its length, and that of chance does not.

    Args:
        gain: For torques the smaller of the gains on held-out data and in sample; for poses and rests, where chance has
            a known distribution, the squares that it explains in sample.
        chance: Threshold that no effect reaches by chance.
    """
    return GateResult("more than chance", gain, chance, "gain", gain > chance)
