"""How well a reading of the data (as it stands, joints swapped, in degrees) fits the model, friction left free."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from identification.checks.smooth import Smooth
from phantom_dyn.dynamics import inverse_dynamics, modelled_friction
from phantom_dyn.motion import Motion
from phantom_dyn.robot import Robot

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
