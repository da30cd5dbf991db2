"""The gate of the gap: does an effect close a part of the gap that is larger than the errors of the method?

The gap is the squared residual of the given model beyond the noise. The gain of an effect is the decrease of the
squared residual when the effect is added to a fit.
"""

from __future__ import annotations

from identification.engine.claims import GateResult

# share of the gap that an effect has to close. A law of the right kind with a parameter that is wrong by a tenth leaves
# a residual of this size.
LEAST_SHARE_OF_GAP = 0.01

# share of the squared residual after the other effects: an effect that closes more than this may close less of the gap
# than the share above. Errors of the other laws match no effect of the catalogue, so no wrong effect closes as much of
# that remaining residual.
SHARE_OF_LEFT = 0.75

# share of the squared torque: errors of alignment, derivatives and the linearised tolerances, 2.6 % of a torque. A
# smaller difference between two explanations is no evidence.
ACCURACY = 0.0007

# times: the gain by encoder noise alone, which is added to the gain that a claim needs.
SPURIOUS_FACTOR = 2.0


def fair_part_of_the_gap(gain: float, needed: float) -> GateResult:
    """Does the effect close a fair part of the gap on its joints, beyond encoder noise and the price of its parameters?

    An effect that closes a larger share of the gap, or most of the residual after the other effects, would pass. If
    encoder noise sets the threshold, the effect would pass in a recording with finer encoders.

    Args:
        gain: The smaller of the gains on held-out data and in sample.
        needed: A fair part of the gap on the joints of the effect, or of the residual after the other effects, plus
            twice the gain by encoder noise and the price of further parameters.
    """
    return GateResult("fair part of the gap", gain, needed, "gain", gain > needed)
