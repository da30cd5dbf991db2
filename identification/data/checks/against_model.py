# pyright: reportAttributeAccessIssue=false
"""Checks a recording against the model for wrong signs, joints in the wrong order, and positions in degrees.

The torque is fitted by linear regression on the model torque and free friction. A sign is checked by the signs of the
coefficients. For order and degrees, the fit of the data as recorded is compared with the fit of changed data.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from identification.data.checks.readings.reading import Reading, with_order, with_positions_times
from identification.data.checks.smoothed_copy import SmoothedRecording
from identification.data.recording import Recording
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.dynamics import gravity_torque, inverse_dynamics, modelled_friction
from phantom_dyn.model.robot import Robot, position_limits
from phantom_dyn.motion import Motion

_ROWS = 300  # samples in a regression: enough for four coefficients, and quick for many pairs of joints
_DEGREE = np.pi / 180  # [rad]
_FAR = 4 * np.pi  # [rad]: a joint without limits may travel two turns, but seldom more
_CLEAR = 0.3  # the sign of a slope, or of a correlation of friction, counts if its absolute value is above this number
_MOST_JOINTS = 12  # pairs of joints are tried up to this number of joints


@dataclass(frozen=True)
class TorqueRegression:
    """Regression of one measured torque on model torque, viscous and Coulomb friction and an offset.

    Attributes:
        slope: Measured torque per modelled torque, in each half of the record.
        friction: Correlation between fitted friction and the measured torque without fitted model torque and offset;
            positive if friction opposes the motion.
        unexplained: Share of the measured torque's variance that is in the residual, if the slope cannot be negative.
        model_share: Share of this variance that the model torque explains in addition to friction, with any slope.
    """

    slope: tuple[float, float]
    friction: float
    unexplained: float
    model_share: float


def spread_samples(smooth: SmoothedRecording) -> Reading | None:
    """Samples for regressions, spread evenly over the record; None without torque or with too few samples."""
    rows = smooth.rows(_ROWS)
    if smooth.tau is None or len(rows) < 50:
        return None
    tau = smooth.tau[rows]
    return Reading(smooth.motion(rows), smooth.sign[rows], tau, np.zeros_like(tau))


def model_torque(robot: Robot, motion: Motion) -> Float[Array, "N nv"]:
    """Torque of the rigid model without the modelled friction, because the fits have free friction."""
    return inverse_dynamics(robot, motion) - modelled_friction(robot, motion)


def least_squares(columns: Float[Array, "N k"], target: Float[Array, " N"]) -> tuple[Float[Array, " k"], float]:
    """Least-squares coefficients and the sum of squared residuals."""
    scale = np.linalg.norm(columns, axis=0)
    scale[scale == 0] = 1.0
    coefficients = np.linalg.lstsq(columns / scale, target, rcond=1e-9)[0] / scale
    return coefficients, float(np.sum((target - columns @ coefficients) ** 2))


def regress_torque(
    model: Float[Array, " N"], v: Float[Array, " N"], sign: Float[Array, " N"], tau: Float[Array, " N"]
) -> TorqueRegression | None:
    """Regression of ``tau`` on the model torque, friction and an offset; None if the torque does not vary.

    Args:
        model: Model torque without friction [N m or N].
        v: Velocity of the joint [rad/s or m/s].
        sign: Low-passed sign of the velocity.
        tau: Measured torque [N m or N].
    """
    total = float(np.sum((tau - tau.mean()) ** 2))
    if total <= 1e-18 * len(tau) * max(1.0, float(np.max(np.abs(tau)))) ** 2:
        return None
    friction_columns = np.column_stack([v, sign, np.ones(len(v))])
    columns = np.column_stack([model, friction_columns])
    coefficients, squares_of_all = least_squares(columns, tau)
    squares_of_friction = least_squares(friction_columns, tau)[1]
    half = len(tau) // 2
    slopes = (
        float(least_squares(columns[:half], tau[:half])[0][0]),
        float(least_squares(columns[half:], tau[half:])[0][0]),
    )
    measured_friction = tau - model * coefficients[0] - coefficients[3]
    fitted_friction = v * coefficients[1] + sign * coefficients[2]
    # The drive needs a torque along the velocity if friction opposes the motion: then the correlation is positive.
    direction = np.sign(float(fitted_friction @ v))
    lengths = np.linalg.norm(measured_friction) * np.linalg.norm(fitted_friction)
    friction = float(direction * abs(measured_friction @ fitted_friction) / lengths) if lengths > 0 else 0.0
    # With a negative slope the model torque is not used, and friction alone explains the torque.
    squares = squares_of_all if coefficients[0] > 0 else squares_of_friction
    return TorqueRegression(slopes, friction, squares / total, (squares_of_friction - squares_of_all) / total)


def regress_joints(data: Reading, model: Float[Array, "N nv"]) -> tuple[TorqueRegression | None, ...]:
    """Regression of every joint's torque on the model torque of that joint."""
    return tuple(
        regress_torque(model[:, j], data.motion.v[:, j], data.sign[:, j], data.tau[:, j])
        for j in range(data.tau.shape[1])
    )


def unexplained_shares(data: Reading, model: Float[Array, "N nv"]) -> Float[Array, " nv"]:
    """Share of each joint's torque variance that model and friction do not explain, shape ``(nv,)``.

    It is NaN for a torque that does not vary.
    """
    return np.array([np.nan if one is None else one.unexplained for one in regress_joints(data, model)])


def _inertia_confirms(
    weight: Float[Array, " N"], inertia: Float[Array, " N"], v: Array, sign: Array, tau: Float[Array, " N"]
) -> bool:
    """True if the torque contains the torque of the modelled inertia with the right sign, in both halves of the record.

    Weight and inertia have separate slopes: a counterbalance that is stronger than gravity reverses the weight only.

    Args:
        weight: Modelled torque of gravity.
        inertia: Modelled torque without that of gravity and friction.
        v: Velocity.
        sign: Low-passed sign of the velocity.
        tau: Measured torque.
    """
    columns = np.column_stack([inertia, weight, v, sign, np.ones(len(v))])
    half = len(tau) // 2
    halves = (slice(None, half), slice(half, None))
    return all(least_squares(columns[part], tau[part])[0][0] > _CLEAR for part in halves)


def check_flipped(recording: Recording, robot: Robot, data: Reading, model: Float[Array, "N nv"]) -> tuple[str, ...]:
    """Sentences on torques with the opposite sign of the modelled torque or of friction.

    Args:
        recording: Raw samples.
        robot: The given model.
        data: Samples of the recording.
        model: Torque of the model without friction for ``data``.
    """
    weight = gravity_torque(robot, data.motion.q)
    out, both_ways = [], np.ptp(np.sign(data.motion.v), axis=0) == 2
    for j, (joint, found) in enumerate(zip(recording.joint_names, regress_joints(data, model), strict=True)):
        if found is None:
            continue
        # Friction that clearly opposes the motion confirms the sign, unless the model explains most of the variance.
        confirmed = found.friction > _CLEAR and found.model_share < 0.5
        against_model = found.model_share > 0.1 and max(found.slope) < -_CLEAR and not confirmed
        if against_model and found.friction > -_CLEAR:
            of_joint = (samples[:, j] for samples in (weight, model - weight, data.motion.v, data.sign, data.tau))
            against_model = not _inertia_confirms(*of_joint)
        # If a joint moves in one direction only, friction and offset are the same column, with arbitrary signs.
        against_friction = both_ways[j] and found.model_share < 0.1 and found.friction < -0.7
        if against_model or against_friction:
            what = "the model needs" if against_model else "friction needs"
            out.append(
                f"{recording.file}: the torque of {joint} has the opposite sign of what {what} for its motion: flip "
                "tau (sign: -1 in the column map), or q and v if those are wrong."
            )
    return tuple(out)


def _clearly_better(before: Float[Array, " nv"], after: Float[Array, " nv"], joints: list[int]) -> bool:
    """True if changed data fit all of ``joints`` far better, and the other joints not much worse.

    Args:
        before: Unexplained share of every joint with the data as recorded.
        after: Unexplained share of every joint with the changed data.
        joints: Joints whose data are changed.
    """
    if np.isnan(before[joints]).any() or np.isnan(after[joints]).any():
        return False
    others = np.setdiff1d(np.arange(len(before)), joints)
    worse = float(np.nansum(after[others] - before[others]))
    gained = float(np.sum(before[joints] - after[joints]))
    ratio = float(np.max(after[joints] / before[joints]))
    # Joints with coupled loads fit exchanged data fairly well. They gain little, and so their ratio has to be small.
    by_ratio = ratio < 0.1 and gained > 0.02 and gained > 2 * worse
    by_difference = ratio < 0.5 and gained > 0.6 + 2 * max(worse, 0)
    return by_ratio or by_difference


def check_swapped(
    recording: Recording, robot: Robot, data: Reading, model: Float[Array, "N nv"]
) -> tuple[tuple[str, ...], bool]:
    """Sentences on pairs of joints that fit far better when exchanged, and whether there are any.

    Args:
        recording: Raw samples.
        robot: The given model.
        data: Samples of the recording.
        model: Torque of the model without friction for ``data``.
    """
    before = unexplained_shares(data, model)
    out = []
    if not 2 <= robot.nv <= _MOST_JOINTS:
        return (), False
    for i, j in combinations(range(robot.nv), 2):
        # An exchange can be far better only if the fit of the recorded data is poor.
        if not np.nansum(before[[i, j]]) > 0.02:
            continue
        better = []
        order = list(range(robot.nv))
        order[i], order[j] = j, i
        for positions, torques, what in ((False, True, "torques"), (True, False, "positions"), (True, True, "columns")):
            changed = with_order(data, order, positions=positions, torques=torques)
            changed_model = model_torque(robot, changed.motion) if positions else model
            after = unexplained_shares(changed, changed_model)
            if _clearly_better(before, after, [i, j]):
                better.append((float(np.nanmean(after)), what))
        if better:
            names = f"{recording.joint_names[i]} and {recording.joint_names[j]}"
            out.append(
                f"{recording.file}: the {min(better)[1]} of {names} look swapped: exchanged, they fit the model far "
                "better; check the order of the columns."
            )
    return tuple(out), bool(out)


def check_degrees(
    recording: Recording, robot: Robot | None, data: Reading | None, model: Float[Array, "N nv"] | None
) -> tuple[str, ...]:
    """Sentences on positions that are probably in degrees: far outside the limits, or with a far better fit in degrees.

    Args:
        recording: Raw samples.
        robot: The given model; None to look at the positions only.
        data: Samples for a comparison with the model; None to compare the positions with the limits only.
        model: Torque of the model without friction for ``data``.
    """
    q = recording.q
    revolute = ~robot.prismatic if robot is not None else np.ones(q.shape[1], dtype=bool)
    unlimited = np.full(q.shape[1], np.inf)
    lower, upper = (-unlimited, unlimited) if robot is None else position_limits(robot)
    limited = np.isfinite(upper - lower)
    with np.errstate(invalid="ignore"):
        beyond = np.maximum(q.max(axis=0) - upper, lower - q.min(axis=0))
        outside = limited & (beyond > np.maximum(upper - lower, 0.5))
    far = ~limited & (np.abs(q).max(axis=0) > _FAR) & (np.abs(q).max(axis=0) < 1000)
    # With a model, joints without limits are suspected only by the fit below.
    suspects = revolute & (outside | (far if robot is None else False))
    if robot is not None and data is not None and model is not None and not suspects.any() and revolute.any():
        before = unexplained_shares(data, model)
        changed = with_positions_times(data, np.where(revolute, _DEGREE, 1.0))
        after = unexplained_shares(changed, model_torque(robot, changed.motion))
        known = np.isfinite(before).any() and np.isfinite(after).any()
        if known and np.nanmean(before) > 0.3 and np.nanmean(after) < 0.3 * np.nanmean(before):
            suspects = revolute & (np.abs(q).max(axis=0) > np.pi)
    if not suspects.any():
        return ()
    worst = int(np.argmax(np.where(suspects, np.abs(q).max(axis=0), 0)))
    names = ", ".join(np.array(recording.joint_names)[suspects])
    return (
        f"{recording.file}: the positions of {names} look like degrees (q of {recording.joint_names[worst]} reaches "
        f"{np.abs(q[:, worst]).max():.4g} rad): convert them with unit: deg in the column map.",
    )
