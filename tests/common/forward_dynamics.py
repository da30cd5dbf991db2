"""Acceleration of a robot from mass matrix and inverse dynamics, for comparisons with simulators."""

from __future__ import annotations

import numpy as np

from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.dynamics import inverse_dynamics, mass_matrix
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion


def forward_dynamics(
    robot: Robot, q: Float[Array, "N nv"], v: Float[Array, "N nv"], tau: Float[Array, "N nv"]
) -> Float[Array, "N nv"]:
    """Acceleration under a drive torque, modelled friction included, shape ``(N, nv)`` [rad/s^2 or m/s^2].

    Friction is that of motion: a joint at rest feels none, so it does not stick.
    """
    coasting = Motion(np.arange(float(len(q))), q, v, np.zeros_like(v))
    bias = inverse_dynamics(robot, coasting)
    return np.linalg.solve(mass_matrix(robot, q), (tau - bias)[..., None])[..., 0]
