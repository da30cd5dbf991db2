"""The gates of the judged band: is there a torque, a gap, and is the effect visible in it?

Extra findings and lost second effects in `benchmarks/blind/run.py` show what their thresholds do.
"""

from __future__ import annotations

from identification.engine.claims import GateResult

# share: by which the squared residual of some joint grows without the finding.
VISIBLE_GROWTH = 0.03


def torque_is_there(torque: float) -> GateResult:
    """Is more measured than noise on some joint, so that the torque says anything of the robot?

    A recording in which the drives work passes.

    Args:
        torque: The largest measured torque of a joint, in upper ends of its noise floor.
    """
    return GateResult("torque is there", torque, 1.0, "floors", torque > 1.0)


def gap_is_there(growth: float) -> GateResult:
    """Does the given model leave more than noise on some joint, so that there is anything to explain?

    A larger gap passes, or a quieter recording.

    Args:
        growth: The largest squared residual of a joint over the square of its noise, less one.
    """
    return GateResult("gap is there", growth, VISIBLE_GROWTH, "of the squared noise", growth > VISIBLE_GROWTH)


def visible(growth: float) -> GateResult:
    """Does the residual of some joint grow without it in the judged band, and that of the mean joint not shrink?

    A stronger effect passes; one that is significant above the judged band alone is of no use.

    Args:
        growth: Relative growth of the squared residual where it is largest; minus one if the others shrink more.
    """
    return GateResult("visible", growth, VISIBLE_GROWTH, "of the squared residual", growth >= VISIBLE_GROWTH)
