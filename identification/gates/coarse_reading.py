"""The gates of encoders that are coarser than stated: do their readings show it, and does their rounding matter?"""

from __future__ import annotations

from identification.engine.claims import GateResult

# times the stated step: from which on an encoder is coarser than stated.
COARSE_STEP = 1.5

# share: of some joint's squared noise that coarse readings make, from which on they matter.
COARSE_SHARE = 0.05


def coarser_than_stated(times: float) -> GateResult:
    """Do the readings lie on a lattice that is coarser than the encoder's stated step?

    An encoder passes if its steps in the recording are at least 1.5 times those of ``encoder_counts``.

    Args:
        times: Step of the lattice over the stated one.
    """
    return GateResult("coarser than stated", times, COARSE_STEP, "stated steps", times >= COARSE_STEP)


def rounding_matters(share: float) -> GateResult:
    """Does the rounding make a part of the noise of some joint, in the judged band or above it?

    A coarser reading passes, or a faster motion.

    Args:
        share: The largest share of a joint's squared noise that it makes.
    """
    return GateResult("rounding matters", share, COARSE_SHARE, "of the squared noise", share > COARSE_SHARE)
