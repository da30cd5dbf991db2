"""Base parameters that the motions of a robot can determine, their sizes, and the information of earlier recordings."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from identification.excitation.closable import ordinary_postures, solved_numerically, with_start_between
from identification.regression.base_parameters import base_parameters_of_matrix
from identification.regression.triangular import r_factor
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.dynamics import rigid_body_regressor
from phantom_dyn.dynamics.moving_base import any_base_motion
from phantom_dyn.errors import ParameterError
from phantom_dyn.model.inertia import parameter_names, parameter_units
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion, read_only
from phantom_dyn.random_streams import random_stream

_ORDINARY = 400  # samples that any motion is compared to


@dataclass(frozen=True)
class Base:
    """Columns of the regressor that are designed for.

    Attributes:
        columns: The r independent ones of the standard parameters.
        sizes: Their root mean square in an ordinary motion.
        noise: Torque noise that each joint's rows are divided by, shape ``(nv,)``.
        known: Information per planned sample of what was recorded before, in these units, shape ``(r, r)``.
    """

    columns: tuple[int, ...]
    sizes: Float[Array, " r"]
    noise: Float[Array, " nv"]
    known: Float[Array, "r r"]

    def __post_init__(self):
        for name in ("sizes", "noise", "known"):
            object.__setattr__(self, name, read_only(getattr(self, name)))

    def rows(self, W: Float[Array, "N nv p"]) -> Float[Array, "M r"]:
        """Rows of a regressor, in units of noise and of ordinary size."""
        return ((W / self.noise[:, None])[:, :, list(self.columns)] / self.sizes).reshape(-1, len(self.columns))

    def pulled_back(self, W: Float[Array, "N nv p"], of_information: Float[Array, "r r"]) -> Float[Array, "N nv p"]:
        """Slope in each entry of a regressor of a scalar with the given slope in its information matrix."""
        out = np.zeros_like(W)
        slope = 2.0 / len(W) * self.rows(W) @ of_information
        out[:, :, list(self.columns)] = slope.reshape(*W.shape[:2], -1) / self.sizes / self.noise[:, None]
        return out


def base_of(
    robot: Robot,
    *,
    planned: float = 1.0,
    noise: float | Sequence[float] | None = None,
    earlier: Float[Array, "k p"] | None = None,
) -> Base:
    """Base parameters of a robot.

    Args:
        robot: Gives the rigid body.
        planned: Samples that the new recording will have; they weigh against those of ``earlier``.
        noise: Torque noise [N m or N] of each joint, or one number; 1 by default.
        earlier: Triangular factor of the regressor of what was recorded, see `earlier_factor`.

    Raises:
        ParameterError: If a shape or a value cannot be.
    """
    sigma = _noise(robot, noise)
    names = parameter_names(robot)
    if earlier is not None and (earlier.shape[1] != len(names) or not np.isfinite(earlier).all()):
        raise ParameterError(
            f"The factor of earlier recordings has the shape {earlier.shape}, and {robot.name} has {len(names)} "
            "standard parameters: make it with earlier_factor for this robot."
        )
    W = _ordinary_rows(robot) / sigma[:, None]
    rows = W.reshape(-1, len(names))
    columns = list(base_parameters_of_matrix(rows, names, parameter_units(robot)).independent)
    sizes = np.sqrt((rows[:, columns] ** 2).sum(axis=0) / len(W))
    known = np.zeros((len(columns), len(columns)))
    if earlier is not None:
        scaled = earlier[:, columns] / sizes
        known = scaled.T @ scaled / planned
    return Base(tuple(columns), sizes, sigma, known)


def earlier_factor(robot: Robot, motions: Iterable[Motion]) -> Float[Array, "k p"]:
    """Triangular factor of the regressor of motions that were recorded, to design what they do not show.

    Args:
        robot: Gives the rigid body.
        motions: All samples count: thin a recording out where its rate is far above that of its noise.
    """
    return r_factor(rigid_body_regressor(robot, motion) for motion in motions)


def _noise(robot: Robot, noise: float | Sequence[float] | None) -> Float[Array, " nv"]:
    values = np.atleast_1d(np.asarray(1.0 if noise is None else noise, dtype=float))
    if values.shape not in ((1,), (robot.nv,)) or not (np.isfinite(values) & (values > 0)).all():
        raise ParameterError(
            f"The noise {values} was given for {robot.nv} joints: give a number above 0, or one for each joint."
        )
    return np.broadcast_to(values, (robot.nv,))


def _ordinary_rows(robot: Robot) -> Float[Array, "N nv p"]:
    """Regressor of independent samples that excite everything; those of a chain each reached from where it starts."""
    motion = _ordinary_motion(robot)
    if not solved_numerically(robot):
        return rigid_body_regressor(robot, motion)
    postures = ordinary_postures(robot, _ORDINARY)
    v, a = (np.repeat(part[: len(postures)], 2, axis=0) for part in (motion.v, motion.a))
    q = with_start_between(robot, postures)
    return rigid_body_regressor(robot, Motion(np.arange(float(len(q))), q, v, a))[1::2]


def _ordinary_motion(robot: Robot) -> Motion:
    """Independent samples that excite everything a motion can: any posture, about 1 rad/s and 1 rad/s^2."""
    rng = random_stream("ordinary motion")
    q = rng.uniform(-np.pi, np.pi, (_ORDINARY, robot.nv)) * np.where(robot.prismatic, 0.1, 1.0)
    v, a = rng.normal(size=(2, _ORDINARY, robot.nv)) * np.where(robot.prismatic, 0.3, 1.0)
    base = any_base_motion(rng, _ORDINARY) if robot.floating else None
    return Motion(np.arange(float(_ORDINARY)), q, v, a, base=base)
