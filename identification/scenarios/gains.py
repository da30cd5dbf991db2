"""Estimates gains of position controllers that robot.yaml does not state, by least squares on references and positions.

The torque ``kp (q_ref - q) - kd v`` of a controller is set equal to the modelled torque plus dry friction and a
constant torque that the model lacks. Positions alone determine all torques only relative to ``kp``. So ``kp`` follows
from the gravity and inertia of the model, and has the same relative error. Viscous friction that the model lacks is
included in ``kd``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from identification.data.recording import Recording
from identification.data.signals import process_all
from identification.data.stretches import busiest
from identification.notes import Code, Note
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.dynamics import gravity_torque, inverse_dynamics, modelled_friction
from phantom_dyn.effects.support.rows import damping_unit, stiffness_unit
from phantom_dyn.errors import LogError
from phantom_dyn.model.robot import Controller, Robot

_FEWEST = 100  # smallest number of rows
_LEAST = 1e-9  # range of position errors [rad or m] below which the references count as copies of the readings
# Number of stretches of time in a jackknife. It leaves out whole stretches, as neighbouring samples are correlated.
_STRETCHES = 10
# Largest relative standard deviation of a gain that counts as known; findings are only as accurate as the gain.
_KNOWN = 0.1
# Gravity or inertia counts as determining a gain if its root mean square is at least this share of the root mean square
# of both. The part that friction or a constant torque could explain is removed before.
_DETERMINES = 0.25


@dataclass(frozen=True)
class Gains:
    """Estimated gains of one joint; NaN where the motion does not determine them.

    Attributes:
        joint: Name of the joint.
        kp: Proportional gain [N m/rad or N/m], with the masses of the model.
        kp_std: Standard deviation of ``kp``, without the uncertainty of the model.
        kd: Damping gain [N m s/rad or N s/m], including viscous friction that the model lacks.
        kd_std: Standard deviation of ``kd``.
        ratio: ``kd / kp`` [s]; it does not depend on the model if the joint's viscous friction is small.
        ratio_std: Standard deviation of ``ratio``.
        determined_by: Parts of the model that determine ``kp``: gravity, inertia or both.
    """

    joint: str
    kp: float
    kp_std: float
    kd: float
    kd_std: float
    ratio: float
    ratio_std: float
    determined_by: tuple[str, ...]

    @property
    def known(self) -> bool:
        """True if the gain is known to a tenth."""
        return self.kp > 0 and self.kp_std <= _KNOWN * self.kp


def joints_without_stated_gains(robot: Robot) -> tuple[str, ...]:
    """Driven joints for which robot.yaml states no controller, or a controller without a gain."""
    pairs = zip(robot.joint_names, robot.actuators, strict=True)
    return tuple(joint for joint, a in pairs if a.actuated and (a.controller is None or a.controller.kp <= 0))


def estimated_gains(recordings: Sequence[Recording], robot: Robot) -> tuple[Gains, ...]:
    """Gains of every joint with which the controllers' torque is closest to the modelled torque.

    Args:
        recordings: Recordings with references.
        robot: The given model.

    Raises:
        LogError: If there are no references, one is not finite, or a recording is too short.
    """
    for one in recordings:
        _require_references(one)
    # Five minutes of a long recording are enough for the gains.
    shortened = [busiest(one) for one in recordings]
    without_torque = tuple(replace(one, tau=np.zeros_like(one.q), controlled=True) for one in shortened)
    logs, _ = process_all(without_torque, robot)
    parts = []
    for log in logs:
        motion, q_ref = log.motion, log.q_ref
        assert q_ref is not None
        needed, weight = inverse_dynamics(robot, motion), gravity_torque(robot, motion.q)
        inertia = needed - weight - modelled_friction(robot, motion)
        v = motion.v
        columns = np.stack([q_ref - motion.q, -v, -np.sign(v), np.ones_like(v), needed, weight, inertia], axis=-1)
        parts.append(log.band(columns)[log.valid_in_band])
    samples = np.concatenate(parts)
    ranges = np.max([np.ptp(one.q_ref - one.q, axis=0) for one in recordings if one.q_ref is not None], axis=0)
    return tuple(_joint_gains(robot.joint_names[j], samples[:, j], float(ranges[j])) for j in range(robot.nv))


def with_estimated_gains(robot: Robot, recordings: tuple[Recording, ...]) -> tuple[Robot, tuple[Recording, ...]]:
    """The robot with estimated controllers for joints without stated ones, and recordings with notes on the estimates.

    Args:
        robot: The given model.
        recordings: Recordings with references.

    Raises:
        LogError: If the motion does not show the gain of a joint; the message has the estimate and its deviation.
    """
    lacking = joints_without_stated_gains(robot)
    if not lacking:
        return robot, recordings
    found = [one for one in estimated_gains(recordings, robot) if one.joint in lacking]
    unknown = [one for one in found if not one.known]
    if unknown:
        raise LogError(_refusal(recordings[0].file, robot, unknown))
    gains = {one.joint: Controller("pd", one.kp, one.kd) for one in found}
    actuators = tuple(
        replace(actuator, controller=gains[joint]) if joint in gains else actuator
        for joint, actuator in zip(robot.joint_names, robot.actuators, strict=True)
    )
    notes = tuple(_note(robot, one) for one in found)
    first = replace(recordings[0], notes=(*recordings[0].notes, *notes))
    marked = tuple(replace(one, gains_estimated=lacking) for one in (first, *recordings[1:]))
    return replace(robot, actuators=actuators), marked


def _require_references(recording: Recording) -> None:
    if recording.q_ref is None:
        raise LogError(f"{recording.file} has no q_ref.<joint> of every joint, so the gains cannot be estimated.")
    if len(recording.t) < _FEWEST or not np.isfinite(recording.q_ref).all():
        raise LogError(f"{recording.file} is too short, or a reference is no number, so the gains cannot be estimated.")


def _joint_gains(joint: str, samples: Float[Array, "n 7"], error_range: float) -> Gains:
    """Estimated gains of one joint.

    Args:
        joint: Name of the joint.
        samples: Position error, -v, -sign(v), 1, modelled torque, and its parts from gravity and from inertia.
        error_range: Range of the position error [rad or m].
    """
    columns, needed = samples[:, :4], samples[:, 4]
    if error_range < _LEAST or len(samples) < 2 * columns.shape[1]:
        return _unknown_gains(joint)
    best = _fitted(columns, needed)
    if not best[0] > 0:
        return _unknown_gains(joint)
    stretch = np.arange(len(samples)) * _STRETCHES // len(samples)
    without_each = np.array([_fitted(columns[stretch != k], needed[stretch != k]) for k in range(_STRETCHES)])
    std = np.sqrt((_STRETCHES - 1) * without_each.var(axis=0)).tolist()
    basis = np.linalg.qr(columns[:, 1:])[0]  # basis of what friction and a constant torque can explain
    squares = [float(np.linalg.norm(part - basis @ (basis.T @ part))) ** 2 for part in samples[:, 5:].T]
    shares = zip(("gravity", "inertia"), squares, strict=True)
    determined_by = tuple(name for name, square in shares if square > _DETERMINES**2 * max(sum(squares), 1e-300))
    return Gains(joint, best[0], std[0], best[1], std[1], best[2], std[2], determined_by)


def _unknown_gains(joint: str) -> Gains:
    """Gains of a joint whose motion does not determine them."""
    none = float("nan")
    return Gains(joint, none, none, none, none, none, none, ())


def _fitted(columns: Float[Array, "n 4"], needed: Float[Array, " n"]) -> tuple[float, float, float]:
    """Proportional gain, damping gain that is not negative, and their ratio."""
    scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    kp, kd = (np.linalg.lstsq(columns / scale, needed)[0] / scale)[:2].tolist()
    return kp, max(kd, 0.0), max(kd, 0.0) / kp if kp > 0 else float("nan")


def _note(robot: Robot, one: Gains) -> Note:
    """A note on the gains of one joint, the part of the model that determines them, and their ratio."""
    tolerance = robot.tolerance.inertia * one.kp
    numbers = {
        "kp": one.kp,
        "kp_std": float(np.hypot(one.kp_std, tolerance)),
        "kp_unit": stiffness_unit(robot, one.joint),
        "kd": one.kd,
        "kd_std": float(np.hypot(one.kd_std, tolerance * one.ratio)),
        "kd_unit": damping_unit(robot, one.joint),
        "determined_by": one.determined_by,
        "ratio": one.ratio,
        "ratio_std": one.ratio_std,
    }
    return Note(Code.GAINS_ESTIMATED, one.joint, numbers)


def _refusal(file: str, robot: Robot, unknown: Sequence[Gains]) -> str:
    """Error message for joints whose gains are too uncertain."""
    names = ", ".join(one.joint for one in unknown)
    found = [
        f"kp of {one.joint} is {one.kp:.2g} ± {one.kp_std:.2g} {stiffness_unit(robot, one.joint)}"
        for one in unknown
        if np.isfinite(one.kp)
    ]
    return (
        f"{file}: positions and references only, and neither gravity nor inertia tells the gain kp of {names} in this "
        f"motion{' (' + ', '.join(found) + ')' if found else ''}: state controller: {{kind: pd, kp: ..., kd: ...}} "
        "under joints in robot.yaml, in N m/rad and N m s/rad at the joint, or record a faster motion with wide "
        "postures. Without a gain, only joints that rest under loads of either sign (weight or f. columns), with "
        "encoder_side: link, can be judged."
    )
