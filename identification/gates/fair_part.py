"""The gate of the gap: does a claim close a part of it that is larger than the errors of the method?"""

from __future__ import annotations

from identification.engine.claims import GateResult

# share: of the gap. A law of the right kind whose parameter is off by a tenth leaves as much.
LEAST_SHARE_OF_GAP = 0.01

# share: of what the other effects of the set leave. Errors of their laws are no effect of the catalogue, so that no
# other effect takes away half of their amplitude.
SHARE_OF_LEFT = 0.75

# share of the squared torque: alignment, derivatives and the linearised tolerance have errors of 2.6 % of a torque,
# squared here.
ACCURACY = 0.0007

# times: the gain by encoder noise alone that a claim needs.
SPURIOUS_FACTOR = 2.0


def fair_part_of_the_gap(gain: float, needed: float) -> GateResult:
    """Does the effect close a fair part of the gap on its joints, beyond encoder noise and the price of its parameters?

    An effect that closes a larger share of the gap would pass, or nearly all that the other effects leave, or one in a
    recording with finer encoders if their noise sets the threshold.

    Args:
        gain: The smaller of the gains on held-out data and in sample.
        needed: A fair part of the gap on its joints, or of what the other effects leave; beside it twice the gain by
            encoder noise, and the price of its parameters.
    """
    return GateResult("fair part of the gap", gain, needed, "gain", gain > needed)
