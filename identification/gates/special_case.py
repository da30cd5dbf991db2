"""The gates of the size: does a finding differ from zero, from a simpler law, from a part of the robot that is missing?

What their thresholds do shows in the extra findings and the lost second effects of `benchmarks/blind/run.py`.
"""

from __future__ import annotations

from identification.engine.claims import GateResult

# probability: (Wald's test) that a linear law has a size in the fit that states it.
DIFFERS_FROM_ZERO = 0.95

# probability: (Student's test) that play and spring of a joint are each more than nothing beside the other.
BOTH_THERE = 0.99

# share: of the squared torque that wrong inertial parameters explain. From here on a note names the part of the model
# whose absence would make that torque; half of the amplitude may be left.
PART_SHARE = 0.75

# share: of the same. From here on the absence of the part is the finding; a third of the amplitude may be left, which
# includes the tolerances of the links before it.
PART_CERTAIN = 0.9


def differs_from_simpler(certain: float) -> GateResult:
    """Does the size of an effect differ from zero, and the effect from the simpler law that it tends to?

    A stronger effect passes, or a recording that shows it more.

    Args:
        certain: Probability of a smaller departure from zero or from the simpler law if that were true.
    """
    return GateResult("differs from simpler", certain, DIFFERS_FROM_ZERO, "probability", certain >= DIFFERS_FROM_ZERO)


def both_are_there(certain: float) -> GateResult:
    """In recordings at rest: does each of play and spring in one joint differ from zero beside the other?

    Rests under loads of more sizes pass, as these separate play from spring.

    Args:
        certain: Probability of a smaller size if the true one were zero, of the less certain of the two.
    """
    return GateResult("both are there", certain, BOTH_THERE, "probability", certain > BOTH_THERE)


def more_than_a_missing_part(share: float) -> GateResult:
    """Do wrong inertial parameters explain more than the absence of a part that the model carries?

    They pass where the absence of the part leaves more than a tenth of the squared torque that they explain.

    Args:
        share: Share of that squared torque that the absence of the part explains.
    """
    left = 1.0 - share
    return GateResult(
        "more than a missing part", left, 1.0 - PART_CERTAIN, "of the squared torque", share < PART_CERTAIN
    )
