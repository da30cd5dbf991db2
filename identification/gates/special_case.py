"""Gates that compare a finding with simpler explanations: no effect, a simpler law, a missing part of the robot.

`benchmarks/blind/run.py` counts the extra findings and the lost second effects that result.
"""

from __future__ import annotations

from identification.engine.claims import GateResult

# probability: smallest certainty, by Wald's test, that the size of an effect is not zero, in the fit whose parameters
# are reported. A search tries fifty effects on joints or more. With 0.95 two or three of fifty would differ from zero
# by chance; with 0.999 one does in a twentieth of the searches.
DIFFERS_FROM_ZERO = 0.999

# probability: smallest certainty, by the same test, that an effect differs from its simpler law: a single comparison.
# It also holds if noise cannot cause the gap that the effect closes: some effect is then certain, and the only question
# is which one.
DIFFERS_FROM_SIMPLER = 0.95

# probability: smallest certainty, by Student's test, that play and spring of a joint are both not zero if both are
# fitted.
BOTH_THERE = 0.99

# share: of the squared torque that wrong inertial parameters explain. If the absence of one part of the model explains
# at least this share of it, a note names the part. The remaining torque then has at most half of the amplitude.
PART_SHARE = 0.75

# share: from this share on, the missing part is reported as the finding instead of wrong inertial parameters. The
# remaining torque has at most a third of the amplitude; it includes errors, within tolerances, of the links before the
# part.
PART_CERTAIN = 0.9


def differs_from_simpler(certain: float, effect_is_certain: bool) -> GateResult:
    """Is the size of an effect not zero, and does the effect differ from the simpler law that is its special case?

    For example, Coulomb friction is the simpler law of Stribeck friction. A stronger effect would pass, or a recording
    that shows the effect more clearly.

    Args:
        certain: Probability that a recording without the difference (size zero, or the simpler law true) would show a
            smaller one.
        effect_is_certain: True if some effect is certain: the special case is a simpler law, or the gap that the effect
            closes cannot be noise. False if there may be no effect at all.
    """
    needed = DIFFERS_FROM_SIMPLER if effect_is_certain else DIFFERS_FROM_ZERO
    return GateResult("differs from simpler", certain, needed, "probability", certain >= needed)


def both_are_there(certain: float) -> GateResult:
    """In recordings at rest: are play and spring of one joint both not zero if both are fitted?

    Recordings under loads of more sizes would pass, as these separate play from spring.

    Args:
        certain: Probability that a recording with a true size of zero would show a smaller size; the lower one of play
            and spring.
    """
    return GateResult("both are there", certain, BOTH_THERE, "probability", certain > BOTH_THERE)


def more_than_a_missing_part(share: float) -> GateResult:
    """Do wrong inertial parameters explain the torque much better than the absence of one part of the model?

    The simpler statement is that the robot lacks this part. The gate passes if the missing part alone explains less
    than nine tenths of the squared torque that the wrong parameters explain.

    Args:
        share: Share of that squared torque that the missing part alone explains.
    """
    left = 1.0 - share
    return GateResult(
        "more than a missing part", left, 1.0 - PART_CERTAIN, "of the squared torque", share < PART_CERTAIN
    )
