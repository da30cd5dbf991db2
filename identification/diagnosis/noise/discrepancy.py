"""By how much a model of the right kind is wrong on drives of a class: a share of torque, and a part at reversals.

No law of friction and no torque constant holds to the last digit. How far off they are is a matter of the drive, and is
stated here by what the torque column is; it is never read from the residual that it excuses.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from identification.diagnosis import decision_rules as rules
from identification.diagnosis.columns.session import Series, Session
from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.dynamics.dynamics import modelled_friction

# Share of the torque that both parts together reach at most: an ordinary effect makes a tenth of it; and the share that
# the error of the model reaches at most that another recording has shown.
MOST, MOST_SHOWN = 0.02, 0.1


@dataclass(frozen=True)
class DriveClass:
    """How far the torque of a sound drive of some kind is from its model.

    Attributes:
        of_torque: Share of the measured torque: derivatives, filters and torque constants are no better than this.
        of_friction: Share of the modelled friction near reversals and while the joint creeps.
    """

    of_torque: float
    of_friction: float


# By ``torque_source``: a command leaves out what the drive makes of it, a current what the gears do, a sensor neither.
DRIVE_CLASSES = {
    "command": DriveClass(0.005, 0.1),
    "current": DriveClass(0.005, 0.1),
    "sensor": DriveClass(0.003, 0.05),
}


def discrepancy(
    session: Session, usable: tuple[Float[Array, "n nv"], ...], torque: Float[Array, " nv"]
) -> Float[Array, " nv"]:
    """Root mean square in the judged band by which a sound model may be wrong on each joint [N m or N], ``(nv,)``.

    Args:
        session: Robot and recordings.
        usable: What each sample in the band counts, for each log.
        torque: Root mean square of each joint's measured torque.
    """
    drive = DRIVE_CLASSES[session.robot.torque_source]
    friction: Series = tuple(log.band(_slow_friction(session, k)) for k, log in enumerate(session.logs))
    shown: Series = tuple(shown_error(session, k)[log.samples] for k, log in enumerate(session.logs))
    counts = np.maximum(sum(np.sum(weight, axis=0) for weight in usable), 1e-12)
    of_friction, of_model = (
        np.sqrt(sum(np.sum(weight * part**2, axis=0) for part, weight in zip(series, usable, strict=True)) / counts)
        for series in (session.in_judged_band(friction), shown)
    )
    of_drive = np.minimum(np.hypot(drive.of_torque * torque, drive.of_friction * of_friction), MOST * torque)
    return np.hypot(of_drive, np.minimum(of_model, MOST_SHOWN * torque))


def shown_error(session: Session, log: int) -> Float[Array, "N nv"]:
    """Deviation of the model's torque in each sample of a log that an earlier diagnosis has found; zero without one."""
    error = session.robot.model_error
    slow = slow_samples(session, log)
    return np.zeros(slow.shape) if error is None else np.where(slow, error[:, 0], error[:, 1])


def slow_samples(session: Session, log: int) -> Bool[Array, "N nv"]:
    """Samples of a log near reversals and where a joint creeps."""
    motion, rate = session.logs[log].motion, session.logs[log].band.rate_hz
    speed = np.abs(motion.v)
    slow = speed < rules.CREEPING_SPEED * np.percentile(speed, 99, axis=0)
    return ndimage.maximum_filter1d(slow, 2 * max(1, round(rules.CREEPING_TIME * rate)) + 1, axis=0)


def _slow_friction(session: Session, log: int) -> Float[Array, "N nv"]:
    """Modelled friction of a log near reversals and where a joint creeps; nothing elsewhere."""
    return np.where(slow_samples(session, log), modelled_friction(session.robot, session.logs[log].motion), 0.0)
