"""The gates of the size: does a finding differ from zero, from a simpler law, from a part of the robot that is missing?

`benchmarks/blind/run.py` counts the extra findings and the lost second effects that result.
"""

from __future__ import annotations

from identification.engine.claims import GateResult

# probability: by Wald's test, that the size of a linear law differs from zero in the fit that states it.
DIFFERS_FROM_ZERO = 0.95

# probability: by Student's test, that play and spring of a joint each differ from zero if both are fitted.
BOTH_THERE = 0.99

# share: of the squared torque that wrong inertial parameters explain. If the absence of a part of the model explains at
# least this share, a note names the part; half of the amplitude may be left.
PART_SHARE = 0.75

# share: of the same torque, above which the absence of the part is the finding. A third of the amplitude may be left,
# which includes the tolerances of the links before it.
PART_CERTAIN = 0.9


def differs_from_simpler(certain: float) -> GateResult:
    """Does the size of an effect differ from zero, and the effect from the simpler law that it tends to?

    A stronger effect would pass, or a recording that shows the effect more clearly.

    Args:
        certain: Probability of a smaller departure from zero or from the simpler law if that were true.
    """
    return GateResult("differs from simpler", certain, DIFFERS_FROM_ZERO, "probability", certain >= DIFFERS_FROM_ZERO)


def both_are_there(certain: float) -> GateResult:
    """In recordings at rest: do play and spring of one joint each differ from zero if both are fitted?

    Recordings under loads of more sizes would pass, as these separate play from spring.

    Args:
        certain: Probability of a smaller size if the true one were zero, of the less certain of the two.
    """
    return GateResult("both are there", certain, BOTH_THERE, "probability", certain > BOTH_THERE)


def more_than_a_missing_part(share: float) -> GateResult:
    """Do wrong inertial parameters explain more than the absence of a part that the model carries?

    They pass if the absence of the part leaves more than a tenth of the squared torque that they explain.

    Args:
        share: Share of that squared torque that the absence of the part explains.
    """
    left = 1.0 - share
    return GateResult(
        "more than a missing part", left, 1.0 - PART_CERTAIN, "of the squared torque", share < PART_CERTAIN
    )
