"""Whether stated controllers gave the recorded torque: where they did not, a simulated loop is another one."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from identification.data.signals import align_held_torque
from identification.estimators.closed_loop.loop import Loop
from identification.regression.regressor import Regressor
from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import LogError

# Share of a recorded torque that its stated controller may leave: noise of a velocity and a held sample leave less.
_FOREIGN = 0.5
# Share that gains read from the recording may leave, so that they are worth a word.
_READ = 0.2


def require_own_controllers(loops: Iterable[Loop]) -> None:
    """Refuse a recording whose torque is not what the stated controllers ask for on its motion.

    Args:
        loops: Controllers and references around the recordings.

    Raises:
        LogError: Names the joint, how far the torques are apart, and gains that would give it where some do.
    """
    for loop in loops:
        log, feedback = loop.log, loop.feedback
        if log.q_ref is None:
            continue
        error, v = log.q_ref - log.motion.q, log.motion.v
        asked = _at_joints(loop, np.clip(feedback.kp * error - feedback.kd * v, -feedback.limit, feedback.limit))
        parts = np.stack([_at_joints(loop, error), _at_joints(loop, -v)], axis=2)
        recorded = Regressor.in_band(log, log.tau)
        for j, joint in enumerate(log.joint_names):
            tau = recorded[:, j]
            left = _share(tau - asked[:, j], tau)
            if feedback.kp[j] == 0.0 or left <= _FOREIGN:
                continue
            gains = np.linalg.lstsq(parts[:, j], tau, rcond=None)[0]
            said = ""
            if _share(tau - parts[:, j] @ gains, tau) < _READ:
                if np.all(gains > 0.0):
                    said = f"; kp = {gains[0]:.3g} and kd = {gains[1]:.3g} would give it"
                elif np.all(gains < 0.0):
                    entry = f"tau.{joint}: {{from: tau.{joint}, sign: -1}}"
                    said = f"; the other sign is nearer: write {entry} into a column map"
            raise LogError(
                f"{log.file}: the stated controller of {joint} (kp {feedback.kp[j]:.3g}, kd {feedback.kd[j]:.3g}) asks "
                f"for another torque than was recorded, {100 * left:.0f} % of it apart{said}: state the controller "
                "that moved the robot, or use an estimator without simulation, such as wls."
            )


def _at_joints(loop: Loop, asked: Float[Array, "N nv"]) -> Float[Array, "n nv"]:
    """What controllers ask for, late and held as the loop says, in the band."""
    t, late = loop.log.motion.t, loop.feedback.delay
    if late:
        asked = np.stack([np.interp(t - late, t, column) for column in asked.T], axis=1)
    return Regressor.in_band(loop.log, align_held_torque(asked) if loop.align else asked)


def _share(part: Float[Array, " n"], whole: Float[Array, " n"]) -> float:
    """Root mean square of a part over that of the whole; zero where there is no torque."""
    size = float(np.sqrt(np.mean(whole**2)))
    return float(np.sqrt(np.mean(part**2))) / size if size > 0.0 else 0.0
