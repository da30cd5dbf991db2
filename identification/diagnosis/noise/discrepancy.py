"""Error that a model of the right form has on a class of drives: a share of the torque, and of friction at reversals.

No law of friction and no torque constant is exact. How large their errors are depends on the drive, and is stated here
by the source of the torque column; it is never estimated from the residual that it would explain.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from identification.diagnosis import decision_rules as rules
from identification.diagnosis.columns.session import Series, Session
from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.dynamics.dynamics import modelled_friction
from phantom_dyn.model.robot import Robot

# Share of the torque that both parts together reach at most, a fifth of what an ordinary effect makes. The error of the
# model that another recording has shown may be as large as such an effect.
MOST = 0.02


@dataclass(frozen=True)
class DriveClass:
    """Error of the modelled torque for a drive without faults.

    Attributes:
        of_torque: Share of the measured torque: derivatives, filters and torque constants are no better than this.
        of_friction: Share of the modelled friction near reversals and while the joint creeps.
        of_noise: Share of the measured torque that the drive may make by itself at random. No sensor shows it, and it
            may lie in the band of the motion.
    """

    of_torque: float
    of_friction: float
    of_noise: float


# By ``torque_source``: a command leaves out the errors of the drive and the gear, a current those of the gear; a torque
# sensor includes both. The noise: repetitions of a motion differ by 1.0 % of the torque on EMPS, a good axis, and by
# 3.4 to 6.3 % on an STS3250 servo with six loads (`benchmarks/noise_floor.py repeated` on their answers).
DRIVE_CLASSES = {
    "command": DriveClass(0.005, 0.1, of_noise=0.025),
    "current": DriveClass(0.005, 0.1, of_noise=0.025),
    "sensor": DriveClass(0.003, 0.05, of_noise=0.0),
}


def drive_noise(robot: Robot, torque: Float[Array, " nv"]) -> Float[Array, " nv"]:
    """Torque that the drives may make by themselves at random, root mean square of each joint [N m or N], ``(nv,)``.

    Args:
        robot: The given model, which states the source of its torques.
        torque: Root mean square of each joint's measured torque.
    """
    return DRIVE_CLASSES[robot.torque_source].of_noise * torque


def discrepancy(
    session: Session, usable: tuple[Float[Array, "n nv"], ...], torque: Float[Array, " nv"]
) -> Float[Array, " nv"]:
    """Root mean square in the judged band by which a sound model may be wrong on each joint [N m or N], ``(nv,)``.

    Args:
        session: Robot and recordings.
        usable: Weight of each sample in the band, for each log.
        torque: Root mean square of each joint's measured torque.
    """
    drive = DRIVE_CLASSES[session.robot.torque_source]
    friction: Series = tuple(
        log.band(np.where(slow_samples(session, k), modelled_friction(session.robot, log.motion), 0.0))
        for k, log in enumerate(session.logs)
    )
    shown: Series = tuple(shown_error(session, k)[log.samples] for k, log in enumerate(session.logs))
    counts = np.maximum(sum(np.sum(weight, axis=0) for weight in usable), 1e-12)
    of_friction, of_model = (
        np.sqrt(sum(np.sum(weight * part**2, axis=0) for part, weight in zip(series, usable, strict=True)) / counts)
        for series in (session.in_judged_band(friction), shown)
    )
    of_drive = np.minimum(np.hypot(drive.of_torque * torque, drive.of_friction * of_friction), MOST * torque)
    return np.hypot(of_drive, np.minimum(of_model, rules.ORDINARY_SHARE * torque))


def shown_error(session: Session, log: int) -> Float[Array, "N nv"]:
    """Error of the model's torque (one sigma) in each sample of a log by an earlier diagnosis; zero without one."""
    error = session.robot.model_error
    slow = slow_samples(session, log)
    return np.zeros(slow.shape) if error is None else np.where(slow, error[:, 0], error[:, 1])


def slow_samples(session: Session, log: int) -> Bool[Array, "N nv"]:
    """Samples of a log near reversals and where a joint creeps."""
    motion, rate = session.logs[log].motion, session.logs[log].band.rate_hz
    speed = np.abs(motion.v)
    slow = speed < rules.CREEPING_SPEED * np.percentile(speed, 99, axis=0)
    return ndimage.maximum_filter1d(slow, 2 * max(1, round(rules.CREEPING_TIME * rate)) + 1, axis=0)
