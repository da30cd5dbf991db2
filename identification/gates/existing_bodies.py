"""The gate of bodies: do bodies that can exist explain the residual as well as unconstrained inertial parameters do?"""

from __future__ import annotations

from identification.engine.claims import GateResult


def bodies_can_exist(possible: float, free: float, chance: float) -> GateResult:
    """Do bodies that can exist explain the residual as well as unconstrained inertial parameters do?

    A body can exist if its pseudo-inertia has no negative eigenvalue and its centre of mass is inside a box around the
    link. If the cause of the residual is wrong bodies in the model, the true bodies explain it, and an unconstrained
    fit gains only by noise beyond them. If impossible bodies gain more, there is another cause, even if possible bodies
    imitate most of it.

    Args:
        possible: In-sample gain (decrease of the loss) of bodies that can exist.
        free: In-sample gain of unconstrained inertial parameters.
        chance: Largest gain by noise alone.
    """
    share, needed = (possible / free, 1.0 - chance / free) if free > 0.0 else (1.0, 0.0)
    return GateResult("bodies can exist", share, needed, "of the gain", share > needed)
