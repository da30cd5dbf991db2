"""The gate of chance: is a gain larger than noise alone can make it? A gain is twice a log-likelihood ratio.

``benchmarks/blind/run.py`` prints false claims and misses with these thresholds, ``benchmarks/blind/power.py`` the
detectable sizes.
"""

from __future__ import annotations

from identification.engine.claims import GateResult

# probability: that in a recording without a gap no effect of the catalogue reaches the threshold of chance.
CLAIM_LEVEL = 0.99

# gain: smallest gain on held-out data that a claim needs, however small the gain by chance is.
LEAST_GAIN = 20.0

# gain: price of one parameter, about the logarithm of the effective number of samples (BIC).
PARAMETER_PRICE = 5.0


def more_than_chance(gain: float, chance: float) -> GateResult:
    """Does the effect gain more than the best one of the whole catalogue, or of its joint, gains by chance?

    A longer recording would pass: the gain of a real effect grows with the length, and the gain by chance does not.

    Args:
        gain: For torques the smaller of the gains on held-out data and in sample; for poses and recordings at rest,
            where the gain by chance has a known distribution, the sum of squares that the effect explains in sample.
        chance: Threshold, which no effect reaches by chance.
    """
    return GateResult("more than chance", gain, chance, "gain", gain > chance)
