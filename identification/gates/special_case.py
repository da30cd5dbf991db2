"""Gates that compare a finding with simpler explanations: no effect, a simpler law, a missing part of the robot.

`benchmarks/blind/run.py` counts the extra findings and the lost second effects that result.
"""

from __future__ import annotations

from identification.engine.claims import GateResult

# probability: by Wald's test, that the size of a linear law differs from zero in the fit that states it.
DIFFERS_FROM_ZERO = 0.95

# probability: by Student's test, that play and spring of a joint each differ from zero if both are fitted.
BOTH_THERE = 0.99

# share of the squared torque that wrong inertial parameters explain. If the robot lacks a part of the model and this
# explains at least the share, a note names the part. The residual may have half of the amplitude.
PART_SHARE = 0.75

# share of the same squared torque above which the missing part is the finding. The residual may have a third of the
# amplitude, which includes the tolerances of the links before the part.
PART_CERTAIN = 0.9


def differs_from_simpler(certain: float) -> GateResult:
    """Does the size of an effect differ from zero, and the effect from the simpler law that it tends to?

    A stronger effect would pass, or a recording that shows the effect more clearly.

    Args:
        certain: Probability of a smaller difference from zero, or from the simpler law, if that law were true.
    """
    return GateResult("differs from simpler", certain, DIFFERS_FROM_ZERO, "probability", certain >= DIFFERS_FROM_ZERO)


def both_are_there(certain: float) -> GateResult:
    """In recordings at rest: do play and spring of one joint each differ from zero if both are fitted?

    Recordings under loads of more sizes would pass, as these separate play from spring.

    Args:
        certain: Probability of a smaller size if the true size were zero; of the less certain of play and spring.
    """
    return GateResult("both are there", certain, BOTH_THERE, "probability", certain > BOTH_THERE)


def more_than_a_missing_part(share: float) -> GateResult:
    """Do wrong inertial parameters explain more than the absence of a part that the model has and the robot lacks?

    They pass if the absence of the part explains less than nine tenths of the squared torque that they explain.

    Args:
        share: Share of that squared torque that the absence of the part explains.
    """
    left = 1.0 - share
    return GateResult(
        "more than a missing part", left, 1.0 - PART_CERTAIN, "of the squared torque", share < PART_CERTAIN
    )
