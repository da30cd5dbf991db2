"""The gate of the gap: a claim has to close a fair part of it, beyond what the method is accurate to."""

from __future__ import annotations

from identification.engine.claims import GateResult

# share: less is left by a law of the right kind whose parameter is off by a tenth.
LEAST_SHARE_OF_GAP = 0.01

# share of the squared torque: alignment, derivatives and the linearised tolerance are right to 2.6 % of a torque; its
# square.
ACCURACY = 0.0007

# times: what encoder noise alone gains, which a claim needs beyond what chance gives.
SPURIOUS_FACTOR = 2.0


def fair_part_of_the_gap(gain: float, needed: float) -> GateResult:
    """Does it close a fair part of the gap of the joints that it acts on, beyond encoder noise and its own price?

    A larger share of the gap passes, or finer encoders where their noise is what is needed most.

    Args:
        gain: The smaller of the gains on held-out data and in sample.
        needed: A fair part of the gap where it acts, twice what encoder noise gains, and the price of more parameters.
    """
    return GateResult("fair part of the gap", gain, needed, "gain", gain > needed)
