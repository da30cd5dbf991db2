"""The gates of sets that the search compares: does another effect explain more, and are all parameters needed?

Scores are held-out losses plus the price of the parameters. `benchmarks/blind/run.py` shows what they find.
"""

from __future__ import annotations

from identification.engine.claims import GateResult

# Margins, in thresholds: least gain of a structure without a name over the 0, 1, 2 or 3 named effects that it replaces.
# Several effects that together do no better than one structure are the less likely cause.
NAMELESS_MARGIN = (1.0, 1.0, 0.0, -0.5)

# gain: differences below this are rounding of the fits, and replace no set by another.
ROUNDING = 1e-6

# share: of what a single named effect explains. A structure with many shapes gains as much by inaccuracies of its law.
NAMELESS_ACCURACY = 0.015


def explains_more_than_others(margin: float, allowed: float = 0.0) -> GateResult:
    """Does the set with it score better on held-out data than all sets with other effects in its place?

    It passes if every replacement explains less after the price of its parameters.

    Args:
        margin: Score of the best set without it less that of the set with it.
        allowed: What the margin has to exceed.
    """
    return GateResult("explains more than others", margin, allowed, "gain", margin > allowed)


def worth_its_numbers(margin: float, accuracy: float) -> GateResult:
    """Does a law explain more than its special case with fewer parameters, beyond the accuracy of the method?

    It passes where the further parameters explain a clear part of what the law explains.

    Args:
        margin: Score of the set with the special case less that of the set with the law.
        accuracy: What the law explains times the relative accuracy of the method.
    """
    return GateResult("worth its numbers", margin, accuracy, "gain", margin >= accuracy)
