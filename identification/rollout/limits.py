# pyright: reportAttributeAccessIssue=false
"""Sentences on modelled joint limits that simulated motion runs past: a simulation has no stops."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from phantom_dyn.robot import Robot

Array = np.ndarray


def limit_warnings(
    robot: Robot, read: tuple[Float[Array, "_ nv"], ...], simulated: tuple[Float[Array, "_ nv"], ...]
) -> tuple[str, ...]:
    """One sentence for each joint whose limits the recording keeps and the simulation does not.

    Args:
        robot: Its model states the limits; a joint without any, or with a turn without end, has none.
        read: Recorded positions of each window.
        simulated: Of the corrected model.
    """
    lower, upper = _limits(robot)
    out = []
    for j, joint in enumerate(robot.joint_names):
        if not np.isfinite([lower[j], upper[j]]).any():
            continue
        past = sum(
            bool(_inside(r[:, j], lower[j], upper[j]) and not _inside(s[:, j], lower[j], upper[j]))
            for r, s in zip(read, simulated, strict=True)
        )
        if past:
            unit = robot.position_units[j]
            out.append(
                f"In {past} of {len(read)} simulated windows {joint} runs past the model's limits of {lower[j]:.4g} to "
                f"{upper[j]:.4g} {unit}, which the recording keeps: a stop may have held it there, and the simulation "
                "has none."
            )
    return tuple(out)


def _inside(q: Array, lower: float, upper: float) -> bool:
    return bool(q.min() >= lower and q.max() <= upper)


def _limits(robot: Robot) -> tuple[Float[Array, " nv"], Float[Array, " nv"]]:
    """Limits of the joints; infinite for those whose configuration is no single number."""
    model = robot.model
    lower, upper = np.full(robot.nv, -np.inf), np.full(robot.nv, np.inf)
    for j, row in enumerate(robot.tree_rows):
        for joint in range(1, model.njoints):
            if model.idx_vs[joint] == row and model.nqs[joint] == model.nvs[joint] == 1:
                low, high = (
                    float(x[model.idx_qs[joint]]) for x in (model.lowerPositionLimit, model.upperPositionLimit)
                )
                if low < high:
                    lower[j], upper[j] = low, high
    return lower, upper
