"""The gates of the sets that the search compares: what takes the place of an effect, and what its numbers are worth.

Scores are held-out losses plus the price of the parameters. `benchmarks/blind/run.py` shows what they find.
"""

from __future__ import annotations

from identification.engine.claims import GateResult

# thresholds: by which a structure is better than 0, 1, 2, 3 named effects whose place it takes: several effects
# together that do no better than one structure are the less likely cause.
NAMELESS_MARGIN = (1.0, 1.0, 0.0, -0.5)

# gain: less than that is rounding of the fits, by which no set takes the place of another.
ROUNDING = 1e-6

# share: of what a single named effect explains, which a structure with many shapes makes good for.
NAMELESS_ACCURACY = 0.015


def explains_more_than_others(margin: float, allowed: float = 0.0) -> GateResult:
    """Does the set with it score better on held-out data than the sets with something else in its place?

    It passes if what would take its place explains less, the prices of their parameters counted.

    Args:
        margin: Score of the best set without it less that of the set with it.
        allowed: What the margin has to exceed.
    """
    return GateResult("explains more than others", margin, allowed, "gain", margin > allowed)


def worth_its_numbers(margin: float, accuracy: float) -> GateResult:
    """Does a richer law explain more than a special case of it by more than the method is accurate to?

    It passes where the further numbers of the law carry a clear part of what it explains.

    Args:
        margin: Score of the set with the special case less that of the set with the law.
        accuracy: Share of what the law explains, to which the method is right.
    """
    return GateResult("worth its numbers", margin, accuracy, "gain", margin >= accuracy)
