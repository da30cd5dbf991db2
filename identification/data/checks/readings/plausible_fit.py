# pyright: reportAttributeAccessIssue=false
"""How well any plausible robot explains a recording: a bounded regression of all joints at once.

Inertial parameters of every link may be half to twice the modelled ones, the last link may carry a payload of five
kilograms plus five times the mass of all links, rotors may have thirty times the inertia of their load, every torque
constant may be half to twice the assumed one, friction may have any size as long as it opposes the motion, and offsets
are free. A large residual of this fit is no property of a robot: the recording is wrong if another reading of the same
data has a far smaller one.
"""

from __future__ import annotations

from dataclasses import dataclass
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
"""Unexplained share of a torque's variance below which a fit is good: real laws of friction differ by as much."""
# Mass of a payload: over that of all moving links, and on the lightest robot [kg]: a bare lever of 0.08 kg may carry 2.
_PAYLOAD, _PAYLOAD_KG = 5.0, 5.0
# Samples over which the inertia at a joint is averaged.
_POSTURES = 12
# Unexplained share below which two fits are the same. What any law of friction leaves is the same in both readings that
# are compared, so that it may be far below `ENOUGH`.
_SAME = 0.0005
# A half of the recording is not used if a torque varies in it by less than this share of its whole variance.
_QUIET = 1e-3
# Weight of the ridge on every coefficient, with columns of length one: the fit loses a millionth.
_RIDGE = 1e-3
# Number of rounds of fitting torque constants and inertias in turn, as their product is not linear.
_TURNS = 3
_PARAMETERS = 10  # inertial parameters of a body
_FIRST = 4  # of them: mass and first moments
_OWN = 4  # columns that each joint has for itself: rotor, viscous and Coulomb friction, offset


class Freedom(NamedTuple):
    """How far a robot may be from its model.

    Attributes:
        factor: Largest factor of an inertia and of a torque constant, either way.
        last: Least part of the modelled last link that is there: a tool may be missing, and its link weighs something.
        rotor: Largest inertia of a rotor behind its gear over what the joint moves.
        offset: Largest offset over the root mean square of the modelled torque.
    """

    factor: float
    last: float
    rotor: float
    offset: float


PLAUSIBLE = Freedom(2.0, 0.05, 30.0, np.inf)
"""Any robot: what leaves a large residual here is no property of one."""
AS_MODELLED = Freedom(1.06, 1 / 1.06, 0.15, 0.5)
"""A robot like its model, but for friction and a payload, to compare readings that some robot explains equally."""


@dataclass(frozen=True)
class _Bounded:
    """Columns that all joints share, those that each joint has for itself, and bounds of their coefficients."""

    shared: Float[Array, "N nv s"]
    own: Float[Array, "N nv 4"]
    low: Float[Array, " s"]
    high: Float[Array, " s"]
    own_low: Float[Array, "nv 4"]
    own_high: Float[Array, "nv 4"]
    factor: float


def unexplained(robot: Robot, reading: Reading, freedom: Freedom = PLAUSIBLE) -> Float[Array, "2 nv"]:
    """Share of each joint's torque variance that no plausible robot explains, in each half of the record.

    Args:
        robot: The given model.
        reading: Samples of the recording.
        freedom: How far the robot may be from its model.

    Returns:
        Shares from 0 on, NaN for a half in which the torque hardly varies.
    """
    columns = _columns(robot, reading, freedom)
    felt = reading.tau + reading.external
    half = len(felt) // 2
    out = np.full((2, felt.shape[1]), np.nan)
    whole = felt.var(axis=0)
    for k, rows in enumerate((slice(None, half), slice(half, None))):
        variance = felt[rows].var(axis=0)
        said = (variance > _QUIET * whole) & varies(felt[rows])
        if said.any():
            out[k, said] = _left(columns, felt, rows, np.flatnonzero(said)) / variance[said]
    return out


def misfit_as_modelled(robot: Robot, reading: Reading) -> float:
    """Sum over the joints of the logarithm of the share that no robot like the model explains, see `AS_MODELLED`."""
    try:
        left = unexplained(robot, reading, AS_MODELLED)
    except ChainError:
        return np.inf
    known = left[:, ~np.isnan(left).all(axis=0)]
    return float(np.sum(np.log(np.nanmean(known, axis=0) + _SAME)))


def _columns(robot: Robot, reading: Reading, freedom: Freedom) -> _Bounded:
    """Columns of the torques with the least and the largest plausible coefficient of each."""
    regressor = rigid_body_regressor(robot, reading.motion)
    modelled = standard_parameters(robot)
    carries = payload_body(robot) - 1
    mass, reach = float(modelled[::_PARAMETERS].sum()), _reach(robot)
    columns, low, high = [], [], []
    for body in range(len(modelled) // _PARAMETERS):
        start = body * _PARAMETERS
        for part in (slice(start, start + _FIRST), slice(start + _FIRST, start + _PARAMETERS)):
            columns.append(regressor[:, :, part] @ modelled[part])
            low.append(freedom.last if body >= carries else 1 / freedom.factor)
            high.append(freedom.factor)
    load = (_PAYLOAD * mass + _PAYLOAD_KG) * (reach / 2) ** np.array([0, 1, 1, 1, 2, 2, 2, 2, 2, 2])
    positive = np.isin(np.arange(_PARAMETERS), (0, 4, 6, 9))  # mass and moments; products and centres have either sign
    columns += list(np.moveaxis(regressor[:, :, carries * _PARAMETERS : (carries + 1) * _PARAMETERS], 2, 0))
    low += list(np.where(positive, 0.0, -load))
    high += list(load)
    ones = np.ones_like(reading.tau)
    postures = np.linspace(0, len(ones) - 1, _POSTURES).astype(int)
    own_low = np.tile([0.0, 0.0, 0.0, -np.inf], (ones.shape[1], 1))
    for column, late in enumerate((reading.late_by_acceleration, reading.late_by_speed)):
        own_low[:, column] -= 0.0 if late is None else late
    own_high = np.full_like(own_low, np.inf)
    own_high[:, 0] = freedom.rotor * np.einsum("njj->nj", mass_matrix(robot, reading.motion.q[postures])).mean(axis=0)
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


def _reach(robot: Robot) -> float:
    """Length scale of a robot [m]: the sum of the distances between its joints and to the last centre of mass."""
    lengths = [float(np.linalg.norm(place.translation)) for place in list(robot.model.jointPlacements)[2:]]
    return max(sum(lengths) + float(np.linalg.norm(robot.model.inertias[robot.model.njoints - 1].lever)), 0.1)


def _left(columns: _Bounded, felt: Float[Array, "N nv"], rows: slice, joints: Array) -> Float[Array, " k"]:
    """Mean squared residual of each joint's torque with the best coefficients within their bounds."""
    count = columns.shared.shape[2]
    low = np.concatenate([columns.low, *(columns.own_low[j] for j in joints)])
    high = np.concatenate([columns.high, *(columns.own_high[j] for j in joints)])
    size = felt[rows][:, joints].std(axis=0)
    wanted = felt[rows][:, joints] / size
    shared, own = columns.shared[rows][:, joints] / size[:, None], columns.own[rows][:, joints] / size[:, None]
    constants = np.ones(len(joints))
    best = np.full(len(joints), np.inf)
    for turn in range(_TURNS):
        x = _bounded(_stacked(shared * constants[:, None], own), wanted.T.ravel(), low, high)
        need = shared @ x[:count]
        each = []
        for k in range(len(joints)):
            part = slice(count + _OWN * k, count + _OWN * (k + 1))
            bounds = (np.r_[1 / columns.factor, low[part]], np.r_[columns.factor, high[part]])
            each.append(_own_fit(need[:, k], own[:, k], wanted[:, k], bounds))
        best = np.minimum(best, np.array([left for _, left in each]))
        constants = np.array([constant for constant, _ in each])
        if turn == 0 and best.max() < _RIDGE:
            break
    return best * size**2


def _stacked(shared: Float[Array, "n k s"], own: Float[Array, "n k 4"]) -> Float[Array, "m c"]:
    """All joints below each other: shared columns first, then those of each joint, which are zero for the others."""
    n, joints, count = shared.shape
    out = np.zeros((joints * n, count + _OWN * joints))
    for k in range(joints):
        out[k * n : (k + 1) * n, :count] = shared[:, k]
        out[k * n : (k + 1) * n, count + _OWN * k : count + _OWN * (k + 1)] = own[:, k]
    return out


def _own_fit(
    need: Float[Array, " n"], own: Float[Array, "n 4"], wanted: Float[Array, " n"], bounds: tuple[Array, Array]
) -> tuple[float, float]:
    """Torque constant of one joint for the torque that its links need, and the mean squared residual."""
    columns = np.column_stack([need, own])
    x = _bounded(columns, wanted, *bounds)
    return float(x[0]), float(np.mean((wanted - columns @ x) ** 2))


def _bounded(columns: Float[Array, "n k"], target: Float[Array, " n"], low: Array, high: Array) -> Float[Array, " k"]:
    """The best coefficients within their bounds."""
    size = np.linalg.norm(columns, axis=0)
    used = (size > 0) & (high > low)
    scale = size[used]
    # A weak ridge keeps the coefficients of nearly equal columns from growing with opposite signs.
    ridge = _RIDGE * np.eye(len(scale))
    padded = np.column_stack(
        [np.vstack([columns[:, used] / scale, ridge]), np.concatenate([target, np.zeros(len(ridge))])]
    )
    # The triangular factor has all information of the fit, in as many rows as there are columns.
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
