# pyright: reportAttributeAccessIssue=false
"""Readings of the data that fit the model far better than the one given: signs, units, order of the joints.

How well a reading of the data (as it stands, joints swapped, in degrees) fits the model, friction left free.

Readings of the data that fit the model far better than the one given: signs, units, order of the joints.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from jaxtyping import Float

from identification.data.checks.smoothed_copy import Smooth
from identification.data.recording import Recording
from phantom_dyn.dynamics.dynamics import inverse_dynamics, modelled_friction
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion

Array = np.ndarray

_ROWS = 300


@dataclass(frozen=True)
class Sample:
    """A few hundred samples of smooth motion and torque, and the sign of the velocity smoothed alike."""

    motion: Motion
    tau: Float[Array, "N nv"]
    sign: Float[Array, "N nv"]


@dataclass(frozen=True)
class Fit:
    """Regression of one measured torque on model torque, viscous and Coulomb friction and an offset.

    Attributes:
        slope: Measured torque per modelled torque, in each half of the record.
        friction: Correlation of what the rest leaves with what friction adds; positive if it opposes motion.
        share: Share of the measured torque's variance that is left, with a slope that cannot be negative.
        model_share: Share of that variance that the model torque explains beyond friction, with any slope.
    """

    slope: tuple[float, float]
    friction: float
    share: float
    model_share: float


def sample(smooth: Smooth) -> Sample | None:
    """Evenly spread samples for fits; None without torque or with too few samples."""
    rows = smooth.rows(_ROWS)
    if smooth.tau is None or len(rows) < 50:
        return None
    return Sample(smooth.motion(rows), smooth.tau[rows], smooth.sign[rows])


def model_torque(robot: Robot, motion: Motion) -> Float[Array, "N nv"]:
    """Torque of the rigid model without its modelled friction, which the fits leave free."""
    return inverse_dynamics(robot, motion) - modelled_friction(robot, motion)


def _left(columns: Float[Array, "N k"], target: Float[Array, " N"]) -> tuple[Float[Array, " k"], float]:
    """Least-squares coefficients and the sum of squares that they leave."""
    scale = np.linalg.norm(columns, axis=0)
    scale[scale == 0] = 1.0
    coefficients = np.linalg.lstsq(columns / scale, target, rcond=1e-9)[0] / scale
    return coefficients, float(np.sum((target - columns @ coefficients) ** 2))


def fit(
    model: Float[Array, " N"], v: Float[Array, " N"], sign: Float[Array, " N"], tau: Float[Array, " N"]
) -> Fit | None:
    """Regression of ``tau`` on the model torque and friction; None where the torque does not vary."""
    total = float(np.sum((tau - tau.mean()) ** 2))
    if total <= 1e-18 * len(tau) * max(1.0, float(np.max(np.abs(tau)))) ** 2:
        return None
    plain = np.column_stack([v, sign, np.ones(len(v))])
    columns = np.column_stack([model, plain])
    coefficients, left = _left(columns, tau)
    friction_left = _left(plain, tau)[1]
    half = len(tau) // 2
    slopes = (
        float(_left(columns[:half], tau[:half])[0][0]),
        float(_left(columns[half:], tau[half:])[0][0]),
    )
    without_friction = tau - model * coefficients[0] - coefficients[3]
    added = v * coefficients[1] + sign * coefficients[2]
    scale = np.linalg.norm(without_friction) * np.linalg.norm(v) * np.linalg.norm(added)
    direction = np.sign(float(added @ v))
    friction = float(direction * abs(without_friction @ added) * np.linalg.norm(v) / scale) if scale > 0 else 0.0
    share = left if coefficients[0] > 0 else friction_left
    return Fit(slopes, friction, share / total, (friction_left - left) / total)


def own_fits(data: Sample, model: Float[Array, "N nv"]) -> tuple[Fit | None, ...]:
    """Fit of every joint's torque on its own model torque."""
    return tuple(
        fit(model[:, j], data.motion.v[:, j], data.sign[:, j], data.tau[:, j]) for j in range(data.tau.shape[1])
    )


def shares(fits: tuple[Fit | None, ...]) -> Float[Array, " nv"]:
    """Unexplained share of every joint; NaN where its torque does not vary."""
    return np.array([np.nan if one is None else one.share for one in fits])


_DEGREE = np.pi / 180
# Without limits, this many rad (two turns) are what a joint may well travel.
_FAR = 4 * np.pi
# Pairs of joints are tried up to this number of joints.
_MOST_JOINTS = 12


def joint_limits(robot: Robot) -> Float[Array, "nv 2"]:
    """Lower and upper position limit of each joint [rad or m]; infinite where there is none."""
    out = np.tile([-np.inf, np.inf], (robot.nv, 1))
    lower, upper = robot.model.lowerPositionLimit, robot.model.upperPositionLimit
    joints = list(robot.model.joints)[1:]
    for row, place in enumerate(robot.tree_rows):
        joint = joints[place]
        if joint.nq == 1 and upper[joint.idx_q] > lower[joint.idx_q]:
            out[row] = lower[joint.idx_q], upper[joint.idx_q]
    return out


def check_flipped(recording: Recording, data: Sample, model: Float[Array, "N nv"]) -> tuple[str, ...]:
    """Torques whose sign is opposite to what the model or friction needs."""
    out = []
    for joint, found in zip(recording.joint_names, own_fits(data, model), strict=True):
        if found is None:
            continue
        # Friction that clearly opposes motion vouches for the sign, unless the model explains most of the torque.
        vouched = found.friction > 0.3 and found.model_share < 0.5
        against_model = found.model_share > 0.1 and max(found.slope) < -0.3 and not vouched
        against_friction = found.model_share < 0.1 and found.friction < -0.7
        if against_model or against_friction:
            what = "the model needs" if against_model else "friction needs"
            out.append(
                f"{recording.file}: the torque of {joint} has the opposite sign of what {what} for its motion: flip "
                "tau (sign: -1 in the column map), or q and v if those are wrong."
            )
    return tuple(out)


def check_unsigned(recording: Recording, data: Sample, model: Float[Array, "N nv"]) -> tuple[str, ...]:
    """Torques that are never negative although the model needs both signs."""
    if recording.tau is None:
        return ()
    out = []
    for j, joint in enumerate(recording.joint_names):
        tau = recording.tau[:, j]
        needed = model[:, j]
        strong = 0.3 * np.sqrt(np.mean(needed**2))
        both = min(np.mean(needed > strong), np.mean(needed < -strong)) > 0.1
        if not (np.min(tau) >= 0 and np.max(tau) > 0 and np.ptp(np.sign(data.motion.v[:, j])) == 2 and both):
            continue
        signed = fit(needed, data.motion.v[:, j], data.sign[:, j], data.tau[:, j])
        unsigned = fit(np.abs(needed), data.motion.v[:, j], data.sign[:, j], data.tau[:, j])
        if signed is not None and unsigned is not None and unsigned.share < 0.8 * signed.share:
            out.append(
                f"{recording.file}: the torque of {joint} is never negative although its motion needs both signs: it "
                "looks like a magnitude; record it with its sign."
            )
    return tuple(out)


def _permuted(data: Sample, i: int, j: int, motion: bool, torque: bool) -> Sample:
    """The data with joints ``i`` and ``j`` exchanged in the motion, the torque or both."""
    order = np.arange(data.tau.shape[1])
    order[[i, j]] = j, i
    m = data.motion
    moved = Motion(m.t, m.q[:, order], m.v[:, order], m.a[:, order]) if motion else m
    return Sample(moved, data.tau[:, order] if torque else data.tau, data.sign[:, order] if motion else data.sign)


def _clearly_better(before: Float[Array, " nv"], after: Float[Array, " nv"], of: list[int]) -> bool:
    """Whether a reading fits the joints ``of`` far better, each of them, and no other joint much worse."""
    if np.isnan(before[of]).any() or np.isnan(after[of]).any():
        return False
    rest = np.setdiff1d(np.arange(len(before)), of)
    worse = float(np.nansum(after[rest] - before[rest]))
    gained = float(np.sum(before[of] - after[of]))
    # Joints that move each other's load fit exchanged data fairly well: then the ratio tells, else the amount.
    ratio = float(np.max(after[of] / before[of]))
    return (ratio < 0.1 and gained > 0.02 and gained > 2 * worse) or (ratio < 0.5 and gained > 0.6 + 2 * max(worse, 0))


def check_swapped(
    recording: Recording, robot: Robot, data: Sample, model: Float[Array, "N nv"]
) -> tuple[tuple[str, ...], bool]:
    """Pairs of joints that fit far better when exchanged, and whether there are any."""
    before = shares(own_fits(data, model))
    out = []
    if not 2 <= robot.nv <= _MOST_JOINTS:
        return (), False
    for i, j in combinations(range(robot.nv), 2):
        # An exchange can only be clearly better where the fit is poor now.
        if not np.nansum(before[[i, j]]) > 0.02:
            continue
        readings = []
        for motion, torque, what in ((False, True, "torques"), (True, False, "positions"), (True, True, "columns")):
            changed = _permuted(data, i, j, motion, torque)
            new_model = model_torque(robot, changed.motion) if motion else model
            after = shares(own_fits(changed, new_model))
            if _clearly_better(before, after, [i, j]):
                readings.append((float(np.nanmean(after)), what))
        if readings:
            names = f"{recording.joint_names[i]} and {recording.joint_names[j]}"
            out.append(
                f"{recording.file}: the {min(readings)[1]} of {names} look swapped: exchanged, they fit the model far "
                "better; check the order of the columns."
            )
    return tuple(out), bool(out)


def _in_degrees(data: Sample, revolute: Array) -> Sample:
    scale = np.where(revolute, _DEGREE, 1.0)
    m = data.motion
    return Sample(Motion(m.t, m.q * scale, m.v * scale, m.a * scale), data.tau, data.sign)


def check_degrees(
    recording: Recording, robot: Robot | None, data: Sample | None, model: Float[Array, "N nv"] | None
) -> tuple[str, ...]:
    """Positions that look like degrees: far outside the limits, or in degrees the torque fits far better."""
    q = recording.q
    revolute = ~robot.prismatic if robot is not None else np.ones(q.shape[1], dtype=bool)
    limits = joint_limits(robot) if robot is not None else np.tile([-np.inf, np.inf], (q.shape[1], 1))
    width = limits[:, 1] - limits[:, 0]
    with np.errstate(invalid="ignore"):
        beyond = np.maximum(q.max(axis=0) - limits[:, 1], limits[:, 0] - q.min(axis=0))
        outside = np.isfinite(width) & (beyond > np.maximum(width, 0.5))
    far = ~np.isfinite(width) & (np.abs(q).max(axis=0) > _FAR) & (np.abs(q).max(axis=0) < 1000)
    suspects = revolute & (outside | (far if robot is None else False))
    if robot is not None and data is not None and model is not None and not suspects.any() and revolute.any():
        before = shares(own_fits(data, model))
        changed = _in_degrees(data, revolute)
        after = shares(own_fits(changed, model_torque(robot, changed.motion)))
        if np.nanmean(before) > 0.3 and np.nanmean(after) < 0.3 * np.nanmean(before):
            suspects = revolute & (np.abs(q).max(axis=0) > np.pi)
    if not suspects.any():
        return ()
    worst = int(np.argmax(np.where(suspects, np.abs(q).max(axis=0), 0)))
    names = ", ".join(np.array(recording.joint_names)[suspects])
    return (
        f"{recording.file}: the positions of {names} look like degrees (q of {recording.joint_names[worst]} reaches "
        f"{np.abs(q[:, worst]).max():.4g} rad): convert them with unit: deg in the column map.",
    )
