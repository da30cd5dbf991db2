"""The gate of bodies: do bodies that can exist explain what inertial parameters explain?"""

from __future__ import annotations

from identification.engine.claims import GateResult


def bodies_can_exist(possible: float, free: float, chance: float) -> GateResult:
    """Do bodies that can exist explain what free inertial parameters explain?

    A body can exist if its pseudo-inertia has no negative eigenvalue and its centre of mass is within its own reach. If
    the cause is wrong bodies in the model, the true bodies explain it, and an unconstrained fit explains only noise
    beyond them. If impossible bodies explain more, there is another cause, even if possible bodies imitate most of it.

    Args:
        possible: Gain in sample of bodies that can exist.
        free: Gain in sample of any inertial parameters.
        chance: Gain that noise makes at most.
    """
    share, needed = (possible / free, 1.0 - chance / free) if free > 0.0 else (1.0, 0.0)
    return GateResult("bodies can exist", share, needed, "of the gain", share > needed)
