r"""The frames of the CEA branch by its modified Denavit-Hartenberg table, and how well its loop closes.

:math:`T_j = Rot_x(\alpha_j)\,Trans_x(d_j)\,Rot_z(\theta_j)` from frame a(j) to frame j; all r, gamma and b are zero.
The loop is cut at joint 7: its frame on link 6, and frame 8 on link 3 (no joint), have to coincide.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from phantom_dyn.devices.cea import LinkLengths, passive_positions

Array = np.ndarray


@dataclass(frozen=True)
class Row:
    """One row of Table 1: joint, frame before it, whether a motor drives it, twist [rad] and length [m].

    ``turns`` is False for frame 8, which is fixed on link 3 (sigma = 2).
    """

    joint: int
    before: int
    driven: bool
    twist: float
    length: float
    turns: bool = True


def table_1(lengths: LinkLengths) -> tuple[Row, ...]:
    """Table 1 with :math:`d_8 = +d_6`, which closes the loop; printed is :math:`-d_6`."""
    quarter = -0.5 * np.pi
    return (
        Row(1, 0, True, 0.0, 0.0),
        Row(2, 1, True, quarter, 0.0),
        Row(3, 2, False, 0.0, lengths.d3),
        Row(4, 3, False, 0.0, lengths.d4),
        Row(5, 1, True, quarter, 0.0),
        Row(6, 5, False, 0.0, lengths.d6),
        Row(7, 6, False, 0.0, lengths.d3),
        Row(8, 3, False, 0.0, lengths.d6, turns=False),
    )


def frames(q: Float[Array, " 3"], rows: tuple[Row, ...]) -> Float[Array, "n 4 4"]:
    """Pose of frames 0, 1, ... in frame 0, the passive angles by (8) to (11).

    Args:
        q: Active angles q1, q2, q5 [rad].
        rows: Of the table, those before a row above it.

    Returns:
        Homogeneous matrices, one per row and the identity in front.
    """
    q3, q4, q6, q7 = passive_positions(q[None])[0]
    angle = dict(enumerate((q[0], q[1], q3, q4, q[2], q6, q7), start=1))
    poses = [np.eye(4)]
    for row in rows:
        poses.append(poses[row.before] @ _step(row.twist, row.length, angle[row.joint] if row.turns else 0.0))
    return np.stack(poses)


def closure_error(q: Float[Array, " 3"], rows: tuple[Row, ...]) -> tuple[float, float]:
    """Distance [m] of the origins of frames 7 and 8, and largest difference of their rotation matrices.

    Args:
        q: Active angles q1, q2, q5 [rad].
        rows: All eight of the table.
    """
    difference = frames(q, rows)[7] - frames(q, rows)[8]
    return float(np.linalg.norm(difference[:3, 3])), float(np.abs(difference[:3, :3]).max())


def _step(twist: float, length: float, angle: float) -> Array:
    ca, sa, c, s = np.cos(twist), np.sin(twist), np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0, length], [ca * s, ca * c, -sa, 0], [sa * s, sa * c, ca, 0], [0, 0, 0, 1]])
