"""The gates of rivals: the likeliest cause of those whose sizes a robot may have is the one that is named.

Shown by ``benchmarks/blind/run.py``: sets with the truth, their size, reliability.
"""

from __future__ import annotations

from identification.engine.claims import GateResult

# times: as many wins as the finding, from which on a rival takes its place: the likeliest leads (contract).
OUTDONE = 1.0
# of the likeliest: causes that together are as likely as that lead where the likeliest needs others to cancel it.
NEARLY_AS_LIKELY = 0.5
# times: power of the torques of several effects, each by itself, over that of their sum, above which they cancel: each
# then makes on average more than twice what they make together.
MOST_CANCELLED = 4.0


def plausible_size(outside: float, unit: str, *, rival_is: bool) -> GateResult:
    """Does it have a size that a sound robot may have, where a rival has one?

    It passes inside the range that its file states as plausible, or if no rival is plausible either.

    Args:
        outside: How far its size is out of that range; zero inside.
        unit: Of the size.
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
    return GateResult("likelier than rivals", own, OUTDONE * rival, "probability", leads)
