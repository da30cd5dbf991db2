"""Expected error of a model without faults: a share of the torque, and a share of the friction at reversals.

No law of friction and no torque constant is exact. The size of their errors depends on the drive. It is stated here for
each source of the torque column, and never estimated from the residual, because it could then explain any residual.
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

# Upper limit of the errors of torque and friction together, as a share of the torque: a fifth of the torque of an
# ordinary effect. Errors that an earlier diagnosis found in another recording may be as large as an ordinary effect.
MOST_DRIVE_ERROR = 0.02


@dataclass(frozen=True)
class DriveClass:
    """Expected error of the modelled torque for a class of drives.

    Attributes:
        torque_error: Error from derivatives, filters and torque constants, as a share of the measured torque.
        friction_error: Error near reversals and while the joint creeps, as a share of the modelled friction.
        random_torque: Random torque of the drive itself, as a share of the measured torque. No sensor shows this
            torque, and its frequencies may be in the band of the motion.
    """

    torque_error: float
    friction_error: float
    random_torque: float


# By ``torque_source``: a command does not contain the errors of drive and gear, a current does not contain those of the
# gear, and a torque sensor measures both. The values of `random_torque` are based on repetitions of a motion: their
# torques differ by 1.0 % on EMPS, a good axis, and by 3.4 to 6.3 % on an STS3250 servo with six loads
# (`benchmarks/noise_floor.py repeated` prints this).
DRIVE_CLASSES = {
    "command": DriveClass(0.005, 0.1, random_torque=0.025),
    "current": DriveClass(0.005, 0.1, random_torque=0.025),
    "sensor": DriveClass(0.003, 0.05, random_torque=0.0),
}


def drive_noise(robot: Robot, torque: Float[Array, " nv"]) -> Float[Array, " nv"]:
    """Root mean square of the random torque that each joint's drive causes [N m or N], ``(nv,)``.

    Args:
        robot: The given model, which states the source of its torques.
        torque: Root mean square of each joint's measured torque [N m or N].
    """
    return DRIVE_CLASSES[robot.torque_source].random_torque * torque


def discrepancy(
    session: Session, usable: tuple[Float[Array, "n nv"], ...], torque: Float[Array, " nv"]
) -> Float[Array, " nv"]:
    """Rms torque error of a model without faults in the judged band, for each joint [N m or N], ``(nv,)``.

    Args:
        session: Robot and recordings.
        usable: Weight of each sample in the judged band, for each log.
        torque: Root mean square of each joint's measured torque [N m or N].
    """
    drive = DRIVE_CLASSES[session.robot.torque_source]
    friction: Series = tuple(
        log.band(np.where(slow_samples(session, k), modelled_friction(session.robot, log.motion), 0.0))
        for k, log in enumerate(session.logs)
    )
    earlier: Series = tuple(earlier_model_error(session, k)[log.samples] for k, log in enumerate(session.logs))
    counts = np.maximum(sum(np.sum(weight, axis=0) for weight in usable), 1e-12)

    def weighted_rms(series: Series) -> Float[Array, " nv"]:
        squares = sum(np.sum(weight * part**2, axis=0) for part, weight in zip(series, usable, strict=True))
        return np.sqrt(squares / counts)

    of_friction, of_model = weighted_rms(session.in_judged_band(friction)), weighted_rms(earlier)
    of_drive = np.hypot(drive.torque_error * torque, drive.friction_error * of_friction)
    of_drive = np.minimum(of_drive, MOST_DRIVE_ERROR * torque)
    return np.hypot(of_drive, np.minimum(of_model, rules.ORDINARY_SHARE * torque))


def earlier_model_error(session: Session, log: int) -> Float[Array, "N nv"]:
    """Rms error of the model's torque in each sample of a log, from an earlier diagnosis; zero if there is none."""
    error = session.robot.model_error
    slow = slow_samples(session, log)
    # `model_error` has two columns: the error near reversals and that in faster motion.
    return np.zeros(slow.shape) if error is None else np.where(slow, error[:, 0], error[:, 1])


def slow_samples(session: Session, log: int) -> Bool[Array, "N nv"]:
    """True for samples of a log near reversals and where a joint creeps."""
    motion, rate = session.logs[log].motion, session.logs[log].band.rate_hz
    speed = np.abs(motion.v)
    slow = speed < rules.CREEPING_SPEED * np.percentile(speed, 99, axis=0)
    return ndimage.maximum_filter1d(slow, 2 * max(1, round(rules.CREEPING_TIME * rate)) + 1, axis=0)
