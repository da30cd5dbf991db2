"""Decides whether a gap counts that shows in a narrower or wider band than the one that is chosen from the data.

A joint has no gap if its residual in the judged band may be noise. The noise of position readings grows with the square
of the frequency, so that in a wide band it hides effects at low frequencies, such as an offset that drifts. A narrow
band lacks most of the torque of play or of a stiff spring, which comes in short pulses. So a robot has no gap only if
it has none in a narrower and in a wider band either.
"""

from __future__ import annotations

from dataclasses import replace

from identification.diagnosis.result import Diagnosis
from identification.engine import contract_levels
from identification.notes import Code, Note

# Factors of the judged band's edge: two octaves below and above.
FACTORS = (0.25, 4.0)
# Smallest factor between the edges of two bands that are judged separately: limits may prevent two octaves.
_LEAST_EDGE_RATIO = 1.5
# Residual of a joint, divided by the largest one of a sound model, above which another band shows a gap. The largest of
# 55 sound robots was 1.53 (`benchmarks/blind/run.py`, users' logs and slow motions).
_CLEAR_GAP_RATIO = 2.0


def are_distinct_bands(first_hz: float, other_hz: float) -> bool:
    """True if the edges of two bands [Hz] are so far apart that both are judged."""
    return max(first_hz, other_hz) >= _LEAST_EDGE_RATIO * min(first_hz, other_hz)


def shows_gap(found: Diagnosis) -> bool:
    """True if a diagnosis in another band has a probable finding, or a residual that is clearly more than noise.

    In one of several bands, a sound robot is more often a little above its noise, or has a finding with many rivals. So
    more is needed than in the band chosen from the data.

    Args:
        found: A diagnosis in a narrower or wider band.
    """
    if found.verdict in ("no_gap", "not_testable"):
        return False
    above = any(joint.rms_after > _CLEAR_GAP_RATIO * joint.allowed for joint in found.joints)
    return above or any(finding.probability > contract_levels.DOUBTED for finding in found.findings)


def with_band_note(found: Diagnosis, first: Diagnosis) -> Diagnosis:
    """A diagnosis in another band, with a note that the band chosen from the data shows no gap.

    Args:
        found: The diagnosis in the other band.
        first: The diagnosis in the band chosen from the data.
    """
    numbers = {"edge": found.band_hz[1], "first": first.band_hz[1]}
    return replace(found, notes=(*found.notes, Note(Code.OTHER_BAND, numbers=numbers)))
