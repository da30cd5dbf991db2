"""The gates of rivals: is the finding the most probable cause among those of a plausible size?

A rival is another cause that may explain the recordings in place of the finding. The cause that leads, finding or
rival, is the one that a diagnosis names; the others are listed with their probabilities.

``benchmarks/blind/run.py`` prints how often the true cause is among finding and rivals, how many there are, and how
reliable their probabilities are.
"""

from __future__ import annotations

from identification.engine.claims import GateResult

# share of the probability of the best cause: if the torques of the best cause cancel each other, a cause whose torques
# do not cancel leads in its place, provided that all these causes together reach this share.
NEARLY_AS_LIKELY = 0.5
# ratio: sum of the powers of several torques over the power of their sum. Above this ratio the torques count as
# cancelling each other. For example, torques of 1 and -0.5 with a sum of 0.5 have a ratio of five.
MOST_CANCELLED = 4.0


def plausible_size(outside: float, unit: str, *, rival_is_plausible: bool) -> GateResult:
    """If some rival has a plausible size, is the size of the finding plausible, too?

    A size inside the range that the effect states as plausible passes. If no rival has a plausible size, any size of
    the finding passes.

    Args:
        outside: Distance of the finding's size from its plausible range; zero inside the range.
        unit: Unit of the size.
        rival_is_plausible: True if a rival has a plausible size.
    """
    return GateResult("plausible size", 0.0 - outside, 0.0, unit, outside == 0.0 or not rival_is_plausible)


def likelier_than_rivals(own: float, rival: float, *, leads: bool) -> GateResult:
    """Is the finding more probable than each of the rivals that could be named in its place?

    A true finding would pass with a motion that separates it from its rivals, such as ``next_experiment`` proposes.

    Args:
        own: Probability of the finding.
        rival: Probability of the most probable rival that could lead.
        leads: True if the finding leads, False if a rival leads.
    """
    return GateResult("likelier than rivals", own, rival, "probability", leads)
