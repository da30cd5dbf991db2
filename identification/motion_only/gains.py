"""Gains of position controllers that nobody has stated, as far as the given model tells them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from identification.recordings import Recording
from identification.signals import process_all
from phantom_dyn.dynamics import inverse_dynamics
from phantom_dyn.errors import LogError
from phantom_dyn.robot import Robot

Array = np.ndarray

_FEWEST = 100  # rows
_LEAST = 1e-9  # [rad or m]: a reference that is nearer is the reading itself


def suggested_gains(recording: Recording, robot: Robot) -> Float[Array, "2 nv"]:
    """Gains kp and kd [N m/rad, N m s/rad; N/m, N s/m] under which the given model moves most like the recording.

    They are as wrong as the masses of the model: positions tell only the ratio of both. Dry friction and a constant
    torque that the model lacks are fitted besides, as they would be taken for gains. NaN for a joint whose motion tells
    none, or whose reference never leaves it.

    Args:
        recording: With references.
        robot: The given model.

    Raises:
        LogError: If there are no references, one is not finite, or the recording is too short.
    """
    if recording.q_ref is None:
        raise LogError(f"{recording.file} has no q_ref.<joint> of every joint, so nothing tells the gains.")
    if len(recording.t) < _FEWEST or not np.isfinite(recording.q_ref).all():
        raise LogError(f"{recording.file} is too short, or a reference is no number, so nothing tells the gains.")
    (log,), _ = process_all((replace(recording, tau=np.zeros_like(recording.q), controlled=True),), robot)
    motion, rows, q_ref = log.motion, log.valid_in_band, log.q_ref
    assert q_ref is not None
    needed = log.band(inverse_dynamics(robot, motion))[rows]
    out = np.full((2, robot.nv), np.nan)
    for j in range(robot.nv):
        v = motion.v[:, j]
        asked = (q_ref[:, j] - motion.q[:, j], -v, -np.sign(v), np.ones_like(v))
        columns = log.band(np.column_stack(asked))[rows]
        if np.ptp(recording.q_ref[:, j] - recording.q[:, j]) < _LEAST or len(columns) < 2 * len(asked):
            continue
        kp, kd, *_ = np.linalg.lstsq(columns, needed[:, j])[0]
        if kp > 0:
            out[:, j] = kp, max(kd, 0.0)
    return out
