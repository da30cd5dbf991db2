"""The gate of chance: gains are in squared standard deviations of the noise, twice a log-likelihood ratio.

``benchmarks/blind/run.py`` prints false claims and misses under its thresholds, ``benchmarks/blind/power.py`` the sizes
that are seen.
"""

from __future__ import annotations

from identification.engine.claims import GateResult

# probability: of a recording without a gap that no effect of the catalogue reaches the threshold by chance.
CLAIM_LEVEL = 0.99

# gain: that a claim needs on held-out data, whatever chance gives.
LEAST_GAIN = 20.0

# gain: of one parameter, about the logarithm of the effective number of samples (BIC).
PARAMETER_PRICE = 5.0


def more_than_chance(gain: float, chance: float) -> GateResult:
    """Does it gain more than chance does over the whole catalogue, or on its joint?

    More of the same motion passes: the gain of a real effect grows with it, and that of chance does not.

    Args:
        gain: Of torques the smaller of the gains on held-out data and in sample; of poses and rests, for which chance
            is known by a distribution, the squares that it explains in sample.
        chance: What no effect reaches by chance.
    """
    return GateResult("more than chance", gain, chance, "gain", gain > chance)
