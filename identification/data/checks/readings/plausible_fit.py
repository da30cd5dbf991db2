# pyright: reportAttributeAccessIssue=false
"""Tests how well any plausible robot explains a recording, by a bounded regression of all joints at once.

In a plausible robot,
- the inertial parameters of every link are half to twice the modelled ones;
- the last link may carry a payload of five kilograms plus five times the mass of all links;
- rotors have at most thirty times the inertia of their load;
- every torque constant is half to twice the assumed one;
- friction has any size, but opposes the motion;
- offsets of the torque are free.

A correct recording of a real robot has a small residual in this fit. So if a correction of the data makes the residual
far smaller, the recording contains a mistake.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import lsq_linear

from identification.data.checks.readings.reading import Reading, varies
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.dynamics import mass_matrix, rigid_body_regressor, standard_parameters
from phantom_dyn.errors import ChainError
from phantom_dyn.model.inertia import payload_body
from phantom_dyn.model.robot import Robot

ENOUGH = 0.005
"""Unexplained share of a torque's variance below which a fit is good: real friction differs by as much from its law."""
# Largest mass of a payload: the first number times the mass of all moving links, plus the second number [kg]. The
# second number is for small robots: a lever of 0.08 kg may carry 2 kg.
_PAYLOAD, _PAYLOAD_KG = 5.0, 5.0
# Number of postures over which the inertia at a joint is averaged.
_POSTURES = 12
# Unexplained share below which two fits are equally good. It is far below `ENOUGH`, because the error of the friction
# law is the same in both fits.
_SAME = 0.0005
# A half of the recording is not used if the variance of the torque in it is less than this share of the whole variance.
_QUIET = 1e-3
# Square root of the ridge penalty on each coefficient, for columns of unit length: the penalty is a millionth.
_RIDGE = 1e-3
# Number of rounds in which inertias and torque constants are fitted in turn: a fit of both at once is not linear.
_ROUNDS = 3
_PARAMETERS = 10  # inertial parameters of a body
_MASS_AND_MOMENTS = 4  # mass and first moments, which are the first of these parameters
_OWN = 4  # number of columns of each single joint: rotor, viscous and Coulomb friction, offset


class Freedom(NamedTuple):
    """How far a robot may be from its model.

    Attributes:
        factor: Inertias and torque constants may be at most this factor larger or smaller than modelled.
        last: Smallest ratio of the last link's inertial parameters to the modelled ones: the modelled tool may be
            missing, but the link itself has some mass.
        rotor: Largest rotor inertia on the joint side, divided by the inertia that the joint moves.
        offset: Largest offset of the torque, divided by the root mean square of the modelled torque.
        load: Largest payload, divided by the largest payload of a plausible robot.
    """

    factor: float
    last: float
    rotor: float
    offset: float
    load: float = 1.0


PLAUSIBLE = Freedom(2.0, 0.05, 30.0, np.inf)
"""Any plausible robot: if the residual is large with this freedom, no robot explains the recording."""
AS_MODELLED = Freedom(1.06, 1 / 1.06, 0.15, 0.5)
"""A robot like its model except for friction and a payload. Of readings that plausible robots explain equally well, the
one that such a robot explains best is chosen."""
WITHOUT_LOAD = AS_MODELLED._replace(load=0.0)
"""A robot like its model except for friction. A payload is excluded, because its first moments can mirror the last
link."""


@dataclass(frozen=True)
class _Bounded:
    """Columns of the torque, and the bounds of their coefficients.

    Attributes:
        shared: Columns whose coefficients are the same for all joints: parameters of the links and of the payload.
        own: Columns with separate coefficients for each joint: rotor, viscous and Coulomb friction, offset.
        low, high: Bounds of the shared coefficients.
        own_low, own_high: Bounds of each joint's own coefficients.
        factor: A torque constant may be at most this factor larger or smaller than assumed.
    """

    shared: Float[Array, "N nv s"]
    own: Float[Array, "N nv 4"]
    low: Float[Array, " s"]
    high: Float[Array, " s"]
    own_low: Float[Array, "nv 4"]
    own_high: Float[Array, "nv 4"]
    factor: float


def _as_is(columns: Array) -> Array:
    """The columns unchanged: the band of samples that were filtered before."""
    return columns


def unexplained(
    robot: Robot, reading: Reading, freedom: Freedom = PLAUSIBLE, band: Callable[[Array], Array] = _as_is
) -> Float[Array, "2 nv"]:
    """Smallest unexplained share of each joint's torque variance with any allowed robot, in each half of the recording.

    Args:
        robot: The given model.
        reading: Samples of the recording.
        freedom: How far the robot may be from its model.
        band: Low pass for the torque and for all columns, if the samples have not been filtered.

    Returns:
        Shares from 0 to about 1; NaN for a half in which the torque hardly varies.
    """
    columns = _bounded_columns(robot, reading, freedom)
    columns = replace(columns, shared=band(columns.shared), own=band(columns.own))
    torque = band(reading.tau + reading.external)
    half = len(torque) // 2
    out = np.full((2, torque.shape[1]), np.nan)
    whole_variance = torque.var(axis=0)
    for k, rows in enumerate((slice(None, half), slice(half, None))):
        variance = torque[rows].var(axis=0)
        used = (variance > _QUIET * whole_variance) & varies(torque[rows])
        if used.any():
            out[k, used] = _mean_squares(columns, torque, rows, np.flatnonzero(used)) / variance[used]
    return out


def misfit_as_modelled(robot: Robot, reading: Reading, freedom: Freedom = AS_MODELLED) -> float:
    """Sum over the joints of the logarithm of the unexplained share, with a robot that is like its model.

    It is infinite if the loops of a closed chain do not close at the positions of the reading.
    """
    try:
        shares = unexplained(robot, reading, freedom)
    except ChainError:
        return np.inf
    known = shares[:, ~np.isnan(shares).all(axis=0)]
    return float(np.sum(np.log(np.nanmean(known, axis=0) + _SAME)))


def _bounded_columns(robot: Robot, reading: Reading, freedom: Freedom) -> _Bounded:
    """Columns of the torque, with the smallest and the largest plausible coefficient of each."""
    regressor = rigid_body_regressor(robot, reading.motion)
    modelled = standard_parameters(robot)
    carries = payload_body(robot) - 1  # index of the body that may carry a payload
    mass, reach = float(modelled[::_PARAMETERS].sum()), _reach(robot)
    columns, low, high = [], [], []
    # Each body has one factor for mass and first moments, and one for the moments and products of inertia.
    for body in range(len(modelled) // _PARAMETERS):
        start = body * _PARAMETERS
        for part in (slice(start, start + _MASS_AND_MOMENTS), slice(start + _MASS_AND_MOMENTS, start + _PARAMETERS)):
            columns.append(regressor[:, :, part] @ modelled[part])
            low.append(freedom.last if body >= carries else 1 / freedom.factor)
            high.append(freedom.factor)
    # The payload has ten free parameters. Its moments grow with powers of half the robot's length.
    load = freedom.load * (_PAYLOAD * mass + _PAYLOAD_KG) * (reach / 2) ** np.array([0, 1, 1, 1, 2, 2, 2, 2, 2, 2])
    positive = np.isin(np.arange(_PARAMETERS), (0, 4, 6, 9))  # mass and moments of inertia; others may be negative
    columns += list(np.moveaxis(regressor[:, :, carries * _PARAMETERS : (carries + 1) * _PARAMETERS], 2, 0))
    low += list(np.where(positive, 0.0, -load))
    high += list(load)
    ones = np.ones_like(reading.tau)
    own_low = np.tile([0.0, 0.0, 0.0, -np.inf], (ones.shape[1], 1))
    # An error of a torque that was computed from a voltage looks like negative rotor inertia or viscous friction.
    for column, error in enumerate((reading.late_by_acceleration, reading.late_by_speed)):
        own_low[:, column] -= 0.0 if error is None else error
    own_high = np.full_like(own_low, np.inf)
    own_high[:, 0] = freedom.rotor * mean_inertia(robot, reading.motion.q)
    if np.isfinite(freedom.offset):
        size = np.sqrt(np.mean((regressor @ modelled) ** 2, axis=0))
        own_low[:, 3], own_high[:, 3] = -freedom.offset * size, freedom.offset * size
    return _Bounded(
        np.stack(columns, axis=2),
        np.stack([reading.motion.a, reading.motion.v, reading.sign, ones], axis=2),
        np.array(low),
        np.array(high),
        own_low,
        own_high,
        freedom.factor,
    )


def mean_inertia(robot: Robot, q: Float[Array, "N nv"]) -> Float[Array, " nv"]:
    """Inertia that each joint moves [kg m^2 or kg], averaged over postures of a recording, shape ``(nv,)``."""
    postures = np.linspace(0, len(q) - 1, _POSTURES).astype(int)
    return np.einsum("njj->nj", mass_matrix(robot, q[postures])).mean(axis=0)


def _reach(robot: Robot) -> float:
    """Length of a robot [m], at least 0.1: the distances from joint to joint and to the last centre of mass, summed."""
    lengths = [float(np.linalg.norm(place.translation)) for place in list(robot.model.jointPlacements)[2:]]
    return max(sum(lengths) + float(np.linalg.norm(robot.model.inertias[robot.model.njoints - 1].lever)), 0.1)


def _mean_squares(columns: _Bounded, torque: Float[Array, "N nv"], rows: slice, joints: Array) -> Float[Array, " k"]:
    """Mean squared residual of each joint's torque with the best coefficients within their bounds.

    In each round, the shared coefficients are fitted to all joints with fixed torque constants. Then the torque
    constant of each joint is fitted with fixed shared coefficients.

    Args:
        columns: Columns of the torque, and the bounds of their coefficients.
        torque: Measured torque with that of measured forces.
        rows: The half of the recording that is fitted.
        joints: Indices of the joints that are fitted.
    """
    count = columns.shared.shape[2]
    low = np.concatenate([columns.low, *(columns.own_low[j] for j in joints)])
    high = np.concatenate([columns.high, *(columns.own_high[j] for j in joints)])
    size = torque[rows][:, joints].std(axis=0)
    target = torque[rows][:, joints] / size
    shared, own = columns.shared[rows][:, joints] / size[:, None], columns.own[rows][:, joints] / size[:, None]
    samples = len(target)
    shared, own, target = with_fewer_rows(shared, own, target)
    constants = np.ones(len(joints))
    best = np.full(len(joints), np.inf)
    for turn in range(_ROUNDS):
        x = bounded_fit(_stacked(shared * constants[:, None], own), target.T.ravel(), low, high)
        need = shared @ x[:count]
        of_joints = []
        for k in range(len(joints)):
            part = slice(count + _OWN * k, count + _OWN * (k + 1))
            bounds = (np.r_[1 / columns.factor, low[part]], np.r_[columns.factor, high[part]])
            of_joints.append(_own_fit(need[:, k], own[:, k], target[:, k], bounds))
        constants, squares = np.transpose(of_joints)
        best = np.minimum(best, squares)
        # A fit that is this good at once cannot become notably better.
        if turn == 0 and best.max() < _RIDGE * samples:
            break
    return best * size**2 / samples


def with_fewer_rows(
    shared: Float[Array, "n k s"], own: Float[Array, "n k 4"], target: Float[Array, "n k"]
) -> tuple[Float[Array, "m k s"], Float[Array, "m k 4"], Float[Array, "m k"]]:
    """Columns and target with few rows, for which any coefficients give the same sum of squared residuals as before.

    The rows of a joint are the triangular factor R of the QR decomposition of all its columns and its target.
    """
    count = shared.shape[2]
    each = [np.column_stack([shared[:, k], own[:, k], target[:, k]]) for k in range(target.shape[1])]
    factors = np.stack([np.linalg.qr(one, mode="r") for one in each], axis=1)
    return factors[:, :, :count], factors[:, :, count:-1], factors[:, :, -1]


def _stacked(shared: Float[Array, "n k s"], own: Float[Array, "n k 4"]) -> Float[Array, "m c"]:
    """Matrix with the rows of all joints below each other: the shared columns, then the columns of each joint.

    The columns of a joint are zero in the rows of the other joints.
    """
    n, joints, count = shared.shape
    out = np.zeros((joints * n, count + _OWN * joints))
    for k in range(joints):
        out[k * n : (k + 1) * n, :count] = shared[:, k]
        out[k * n : (k + 1) * n, count + _OWN * k : count + _OWN * (k + 1)] = own[:, k]
    return out


def _own_fit(
    need: Float[Array, " n"], own: Float[Array, "n 4"], target: Float[Array, " n"], bounds: tuple[Array, Array]
) -> tuple[float, float]:
    """Best factor of a joint's torque constant, and the sum of squared residuals.

    Args:
        need: Torque that the links need with the assumed torque constant.
        own: Columns of the joint's rotor, friction and offset.
        target: Measured torque of the joint.
        bounds: Lower and upper bounds of the factor and of the coefficients of ``own``.
    """
    columns = np.column_stack([need, own])
    x = bounded_fit(columns, target, *bounds)
    return float(x[0]), float(np.sum((target - columns @ x) ** 2))


def bounded_fit(
    columns: Float[Array, "n k"], target: Float[Array, " n"], low: Array, high: Array
) -> Float[Array, " k"]:
    """Least-squares coefficients within their bounds; 0 for zero columns, and where both bounds are equal."""
    size = np.linalg.norm(columns, axis=0)
    used = (size > 0) & (high > low)
    scale = size[used]
    # A weak ridge keeps the coefficients of nearly equal columns from growing with opposite signs.
    ridge = _RIDGE * np.eye(len(scale))
    padded = np.column_stack(
        [np.vstack([columns[:, used] / scale, ridge]), np.concatenate([target, np.zeros(len(ridge))])]
    )
    # The triangular factor has the same solution, with far fewer rows.
    factor = np.asarray(np.linalg.qr(padded, mode="r"))
    out = np.zeros(len(size))
    out[used] = (
        lsq_linear(
            factor[:, :-1],
            factor[:, -1],
            (low[used] * scale, high[used] * scale),
            method="bvls",
            tol=1e-14,
            max_iter=10 * np.count_nonzero(used) + 10,
        ).x
        / scale
    )
    return out
