"""The gates of rivals: is the finding the most probable cause among those of a plausible size?

``benchmarks/blind/run.py`` prints how often the true cause is among finding and rivals, how many there are, and how
reliable their probabilities are.
"""

from __future__ import annotations

from identification.engine.claims import GateResult

# share of the probability of the best cause. If the best cause consists of torques that cancel each other, causes
# without such torques lead in its place if together they reach this share.
NEARLY_AS_LIKELY = 0.5
# ratio: sum of the powers of several torques over the power of their sum. Above it the torques cancel each other: each
# is then on average more than twice as large as their sum.
MOST_CANCELLED = 4.0


def plausible_size(outside: float, unit: str, *, rival_is_plausible: bool) -> GateResult:
    """Is the size of the finding plausible, if that of a rival is?

    A size inside the range that the effect states as plausible passes. If no rival is plausible, any size passes.

    Args:
        outside: Distance of the size from that range; zero inside the range.
        unit: Unit of the size.
        rival_is_plausible: True if a rival has a plausible size.
    """
    return GateResult("plausible size", 0.0 - outside, 0.0, unit, outside == 0.0 or not rival_is_plausible)


def likelier_than_rivals(own: float, rival: float, *, leads: bool) -> GateResult:
    """Is the finding more probable than each of the rivals that could be named in its place?

    It would pass with a motion that separates the two, such as ``next_experiment`` proposes.

    Args:
        own: Probability of the finding.
        rival: Probability of the most probable rival that could lead.
        leads: False if that rival has to lead.
    """
    return GateResult("likelier than rivals", own, rival, "probability", leads)
