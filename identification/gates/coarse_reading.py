"""Gates of coarse encoders: is an encoder coarser than stated, or than those of other joints, and does that matter?"""

from __future__ import annotations

from identification.engine.claims import GateResult

# times the stated step: an encoder with at least this step counts as coarser than stated.
COARSE_STEP = 1.5

# times the step of the other joints: an encoder with at least this step counts as coarse. Gears and encoders of one
# robot differ by less.
COARSE_BESIDE = 10.0

# share: coarse readings matter if their rounding is more than this share of the squared noise of some joint.
COARSE_SHARE = 0.05


def coarser_than_stated(times: float) -> GateResult:
    """Do the readings lie on a lattice that is coarser than the encoder's stated step?

    An encoder passes if its steps in the recording are at least 1.5 times those of ``encoder_counts``.

    Args:
        times: Step of the lattice over the stated one.
    """
    return GateResult("coarser than stated", times, COARSE_STEP, "stated steps", times >= COARSE_STEP)


def coarser_than_others(times: float) -> GateResult:
    """Do the readings of a joint without a stated step lie on a far coarser lattice than those of the other joints?

    An encoder passes if its steps are at least ten times as large as those of most other joints of its kind.

    Args:
        times: Step of the lattice over the median one of the other joints.
    """
    return GateResult("coarser than others", times, COARSE_BESIDE, "steps of other joints", times >= COARSE_BESIDE)


def rounding_matters(share: float) -> GateResult:
    """Is the rounding a large part of the noise of some joint, in the judged band or above it?

    The claim would pass with a coarser encoder or a faster motion.

    Args:
        share: Largest share of the rounding in the squared noise of a joint.
    """
    return GateResult("rounding matters", share, COARSE_SHARE, "of the squared noise", share > COARSE_SHARE)
