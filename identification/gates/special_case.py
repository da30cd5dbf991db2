"""The gates of the size: is an effect more than a special case of itself, than nothing, than a part that is not there?

Extra findings and lost second effects in `benchmarks/blind/run.py` show what their thresholds do.
"""

from __future__ import annotations

from identification.engine.claims import GateResult

# probability: (Wald's test) that a linear law has a size in the fit that states it.
DIFFERS_FROM_ZERO = 0.95

# probability: (Student's test) that play and spring of a joint are each more than nothing beside the other.
BOTH_THERE = 0.99

# share: of the squared torque that wrong inertial parameters explain, from which on a part of the model that would make
# it by its absence is named; what is left of the amplitude is half.
PART_SHARE = 0.75

# share: of the same, from which on the part is what is missing: a third of the amplitude is left, the tolerances of the
# links before it among that.
PART_CERTAIN = 0.9


def differs_from_simpler(certain: float) -> GateResult:
    """Does its size differ from nothing, or from the simpler law that it tends to, in the fit that states it?

    A stronger effect passes, or a recording that shows it more.

    Args:
        certain: Probability that chance keeps its numbers nearer to the special case than they are.
    """
    return GateResult("differs from simpler", certain, DIFFERS_FROM_ZERO, "probability", certain >= DIFFERS_FROM_ZERO)


def both_are_there(certain: float) -> GateResult:
    """Of rests alone: is each of two causes in one joint more than nothing beside the other?

    Rests under loads of more sizes pass, as these separate play from spring.

    Args:
        certain: Probability of the less certain one that chance keeps it below what it is.
    """
    return GateResult("both are there", certain, BOTH_THERE, "probability", certain > BOTH_THERE)


def more_than_a_missing_part(share: float) -> GateResult:
    """Do wrong inertial parameters explain more than the absence of a part that the model carries?

    They pass where more than a tenth of the squared torque is not what the part would make by its absence.

    Args:
        share: Of that squared torque, which the absence of the part explains.
    """
    left = 1.0 - share
    return GateResult(
        "more than a missing part", left, 1.0 - PART_CERTAIN, "of the squared torque", share < PART_CERTAIN
    )
