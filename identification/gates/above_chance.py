"""The gate of chance: is the gain of an effect larger than noise alone can make it?

The gain of an effect is the decrease of the loss when the effect is added to a fit. The loss is the sum of squared
residuals in units of the noise variance, so that a gain is twice a log-likelihood ratio.

``benchmarks/blind/run.py`` prints false claims and misses with these thresholds, ``benchmarks/blind/power.py`` the
detectable sizes.
"""

from __future__ import annotations

from identification.engine.claims import GateResult

# probability: that no effect of the catalogue reaches the threshold of chance in a recording of a robot that its model
# describes without error.
CLAIM_LEVEL = 0.99

# gain: smallest gain on held-out data that a claim needs, however small the gain by chance is.
LEAST_GAIN = 20.0

# gain: price of one parameter, about the logarithm of the effective number of samples (BIC). An explanation with one
# more parameter than another is better only if it gains more than this in addition.
PARAMETER_PRICE = 5.0


def more_than_chance(gain: float, chance: float) -> GateResult:
    """Is the gain of the effect above chance, that is above the largest gain by noise of any effect it competes with?

    These effects are all of the catalogue, or all on the same joint. A real effect would pass in a longer recording,
    because its gain grows with the length, and the gain by chance does not.

    Args:
        gain: For torques the smaller of the gains on held-out data and in sample; for poses and recordings at rest,
            where the gain by chance has a known distribution, the sum of squares that the effect explains in sample.
        chance: Threshold of chance, see `CLAIM_LEVEL`.
    """
    return GateResult("more than chance", gain, chance, "gain", gain > chance)
