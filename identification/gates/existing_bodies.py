"""The gate of bodies: do bodies that can exist explain what inertial parameters explain?"""

from __future__ import annotations

from identification.engine.claims import GateResult

# share: of the gain of unconstrained inertial parameters that bodies which can exist have to reach. Where the bodies of
# the model are wrong, the true ones exist, and an unconstrained fit gains only noise beyond them.
BY_POSSIBLE_BODIES = 0.5


def bodies_can_exist(possible: float, free: float) -> GateResult:
    """Do bodies that can exist explain most of what free inertial parameters explain?

    A body can exist if its pseudo-inertia has no negative eigenvalue and its centre is within its own reach. Bodies
    that are truly wrong pass. Where only impossible bodies explain a gap, its cause is another one.

    Args:
        possible: Gain in sample of bodies that can exist.
        free: Gain in sample of any inertial parameters.
    """
    share = possible / free if free > 0.0 else 1.0
    return GateResult("bodies can exist", share, BY_POSSIBLE_BODIES, "of the gain", share > BY_POSSIBLE_BODIES)
