"""The gate of bodies: do bodies that can exist explain what inertial parameters explain?"""

from __future__ import annotations

from identification.engine.claims import GateResult


def bodies_can_exist(possible: float, free: float, chance: float) -> GateResult:
    """Do bodies that can exist explain what free inertial parameters explain?

    A body can exist if its pseudo-inertia has no negative eigenvalue and its centre is within its own reach. Where the
    bodies of a model are wrong, the true ones exist, and an unconstrained fit gains only noise beyond them. Where
    impossible bodies explain more, the cause is another one, however much of its torque possible bodies imitate.

    Args:
        possible: Gain in sample of bodies that can exist.
        free: Gain in sample of any inertial parameters.
        chance: Gain that noise makes at most.
    """
    share, needed = (possible / free, 1.0 - chance / free) if free > 0.0 else (1.0, 0.0)
    return GateResult("bodies can exist", share, needed, "of the gain", share > needed)
