"""Gates that compare sets of effects: does another effect explain more, and does a law need all of its parameters?

The loss of a set is the sum of squared residuals, in units of the noise variance, after a fit of its effects. Its score
is its held-out loss plus the price of its parameters; a smaller score is better.
`benchmarks/blind/run.py` counts the right and wrong claims that result.
"""

from __future__ import annotations

from identification.engine.claims import GateResult

# multiples of the threshold of chance: a structure without a name (it matches no effect of the catalogue) replaces 0,
# 1, 2, or at least 3 named effects if this lowers the score by more than these. The last value is negative: the
# structure may replace three effects even if the score rises, because three causes at once are less likely than one.
NAMELESS_MARGIN = (1.0, 1.0, 0.0, -0.5)

# gain: a set replaces another one only if its score is lower by more than this. Smaller differences are rounding.
ROUNDING = 1e-6

# share: a structure without a name that replaces one or two causes has to gain, beyond the margin, this share of what
# the set of effects explains. It is so flexible that it gains this much from errors of their laws.
NAMELESS_ACCURACY = 0.015


def explains_more_than_others(margin: float, allowed: float = 0.0) -> GateResult:
    """Does the set with this effect score better on held-out data than every set with other effects in its place?

    An effect passes if every replacement explains less after the price of its parameters is subtracted.

    Args:
        margin: Score of the best set without the effect minus the score of the set with it.
        allowed: Value that the margin has to exceed.
    """
    return GateResult("explains more than others", margin, allowed, "gain", margin > allowed)


def worth_its_numbers(margin: float, accuracy: float) -> GateResult:
    """Does a law explain more than its special case with fewer parameters, beyond the accuracy of the method?

    A law passes if the gain by its additional parameters is a clear part of the gain of the whole law.

    Args:
        margin: Score of the set with the special case minus the score of the set with the law.
        accuracy: Gain of the law times the relative accuracy of derivatives, filters and linearised laws.
    """
    return GateResult("worth its numbers", margin, accuracy, "gain", margin >= accuracy)
