"""Gates of coarse encoders: is an encoder coarser than stated, or than those of other joints, and does that matter?

All readings of an encoder are multiples of its step. The step in the recording is estimated from the readings.
"""

from __future__ import annotations

from identification.engine.claims import GateResult

# times the stated step: an encoder with at least this step counts as coarser than stated.
COARSE_STEP = 1.5

# times the step of the other joints: an encoder with at least this step counts as coarse. Gears and encoders of one
# robot differ by less.
COARSE_BESIDE = 10.0

# share: coarse readings matter if their rounding makes more than this share of the squared noise of some joint.
COARSE_SHARE = 0.05


def coarser_than_stated(times: float) -> GateResult:
    """Is the step of an encoder in the recording larger than its stated step?

    An encoder passes if its step is at least 1.5 times that which follows from ``encoder_counts``.

    Args:
        times: Step in the recording divided by the stated step.
    """
    return GateResult("coarser than stated", times, COARSE_STEP, "stated steps", times >= COARSE_STEP)


def coarser_than_others(times: float) -> GateResult:
    """Is the step of an encoder without a stated step far larger than the steps of the other joints?

    An encoder passes if its step is at least ten times the median step of the other joints of its kind.

    Args:
        times: Step of the encoder divided by that median step.
    """
    return GateResult("coarser than others", times, COARSE_BESIDE, "steps of other joints", times >= COARSE_BESIDE)


def rounding_matters(share: float) -> GateResult:
    """Is the rounding of the readings a large part of the noise of some joint?

    Frequencies in the judged band (where effects are tested) and above it count. The claim would pass with a coarser
    encoder or a faster motion.

    Args:
        share: Largest share of the rounding in the squared noise of a joint.
    """
    return GateResult("rounding matters", share, COARSE_SHARE, "of the squared noise", share > COARSE_SHARE)
