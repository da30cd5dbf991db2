# pyright: reportAttributeAccessIssue=false
"""Inverse dynamics of the links and rotors along a motion of the active joints, through MuJoCo."""

from __future__ import annotations

import mujoco
import numpy as np

from .plant import Plant, compiled
from .robots import Table


def rigid_torque(table: Table, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
    """Torque that the links and rotors need along a motion, no friction, no effect, ``(N, nv)`` [N m].

    Of a closed chain the passive joints follow linearly, and the torque is projected onto the active ones.

    Args:
        table: The robot.
        q: Active joints, ``(N, nv)`` [rad].
        v: Their velocity.
        a: Their acceleration.
    """
    model = compiled(Plant(table), rigid=True)
    data, select = mujoco.MjData(model), table.selection()
    tree = [x @ select.T for x in (q, v, a)]
    out = np.empty_like(tree[0])
    for k in range(len(q)):
        data.qpos[:], data.qvel[:], data.qacc[:] = tree[0][k], tree[1][k], tree[2][k]
        mujoco.mj_inverse(model, data)
        out[k] = data.qfrc_inverse
    return out @ select


def mass_matrix(table: Table, q: np.ndarray) -> np.ndarray:
    """Mean mass matrix of the active joints over configurations, rotors included, ``(nv, nv)``."""
    nv, zero = len(table.joints), np.zeros_like(q)
    rest = rigid_torque(table, q, zero, zero)
    columns = []
    for j in range(nv):
        unit = zero.copy()
        unit[:, j] = 1.0
        columns.append((rigid_torque(table, q, zero, unit) - rest).mean(axis=0))
    return np.stack(columns, axis=1)
