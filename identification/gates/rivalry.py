"""The gates of rivals: the finding is the most probable cause among those of a plausible size.

``benchmarks/blind/run.py`` prints how often the true cause is among finding and rivals, how many there are, and how
reliable their probabilities are.
"""

from __future__ import annotations

from identification.engine.claims import GateResult

# share: of the probability of the best cause, from which on causes that do not cancel lead in the place of one that
# needs others to cancel it.
NEARLY_AS_LIKELY = 0.5
# ratio: of the summed powers of several effects' torques to the power of their sum, above which they cancel each other:
# each is then on average more than twice as large as their sum.
MOST_CANCELLED = 4.0


def plausible_size(outside: float, unit: str, *, rival_is: bool) -> GateResult:
    """Is its size plausible, where that of a rival is?

    It passes inside the range that the effect states as plausible, or if no rival is plausible either.

    Args:
        outside: Distance of its size from that range; zero inside.
        unit: Unit of the size.
        rival_is: True if a rival has a plausible size.
    """
    return GateResult("plausible size", 0.0 - outside, 0.0, unit, outside == 0.0 or not rival_is)


def likelier_than_rivals(own: float, rival: float, *, leads: bool) -> GateResult:
    """Is it more probable than each of the rivals that could be named in its place?

    A motion that separates the two passes: ``next_experiment`` proposes one.

    Args:
        own: Its probability.
        rival: That of the likeliest rival that could lead.
        leads: False if that rival has to lead.
    """
    return GateResult("likelier than rivals", own, rival, "probability", leads)
