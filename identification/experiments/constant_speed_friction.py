"""Fits viscous and Coulomb friction of joints that move at constant speeds, without a model of the robot.

In triangles of several speeds the velocity is mostly constant. At constant speed, these torques are fitted as
nuisances: an offset, gravity (a sine of the joint's position), centrifugal torque (the square of the joint's speed) and
the small rest of the inertia torque. All other torque is friction.

References:
    A. Janot et al., *Modeling and Identification of a 3 DOF Haptic Interface*, ICRA 2007, the friction tests.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification.data.log import Log
from identification.experiments.linear_fit import LinearFit, fit_linear, without_nuisance
from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.errors import LogError

_STEADY = 1.0  # [1/s]: a speed counts as constant if it changes by less than 1 % in 10 ms
_MOVES = 0.05  # below this share of the largest speed a joint counts as not moving


@dataclass(frozen=True)
class FrictionTest:
    """Friction of one joint in one recording.

    Attributes:
        joint: Name of the joint.
        file: Name of the recording.
        fit: Fit of ``viscous`` and ``coulomb``; its condition number is that of both columns without the nuisances.
        v: Velocities at the samples of constant speed [rad/s or m/s], ``(n,)``.
        torque: Friction torque at these samples, without the fitted nuisances [N m or N], ``(n,)``.
        steady: Share of the joint's motion with constant speed.
    """

    joint: str
    file: str
    fit: LinearFit
    v: Float[Array, " n"]
    torque: Float[Array, " n"]
    steady: float


def fit_steady(
    q: Float[Array, " N"],
    v: Float[Array, " N"],
    a: Float[Array, " N"],
    tau: Float[Array, " N"],
    names: tuple[str, str],
    units: tuple[str, str],
) -> tuple[LinearFit, Float[Array, " n"], Float[Array, " n"]]:
    """Viscous and Coulomb friction of one joint, from samples with constant speed.

    Args:
        q: Positions [rad or m].
        v: Velocities.
        a: Accelerations.
        tau: Drive torque [N m or N].
        names: Names of the two unknowns.
        units: Units of the two unknowns.

    Returns:
        The fit, and velocities and friction torques of the samples that were used.

    Raises:
        LogError: If the joint never has a constant speed.
        IdentifiabilityError: If its speeds do not separate the two unknowns.
    """
    steady = _steady(v, a)
    if not steady.any():
        raise LogError("no constant speed was recorded: move the joint in triangles of several speeds.")
    q, v, a, tau = q[steady], v[steady], a[steady], tau[steady]
    nuisance = np.stack([np.ones_like(q), np.cos(q), np.sin(q), v**2, a], axis=1)
    law = np.stack([v, np.sign(v)], axis=1)
    free = without_nuisance(np.column_stack([law, tau]), nuisance)
    fit = fit_linear(free[:, :2], free[:, 2], names, units)
    return fit, v, law @ fit.theta + free[:, 2] - free[:, :2] @ fit.theta


def _steady(v: Float[Array, " N"], a: Float[Array, " N"]) -> Bool[Array, " N"]:
    """True for samples with constant speed."""
    return np.abs(a) < _STEADY * np.abs(v)


def friction_tests(log: Log, units: tuple[str, ...]) -> tuple[FrictionTest, ...]:
    """Friction of every joint that moves in a recording.

    Args:
        log: Motion and torque.
        units: Units of each joint's torque, ``N m`` or ``N``.

    Raises:
        LogError: If no joint moves, or a joint that moves never has a constant speed.
    """
    motion, out = log.motion, []
    fastest = np.abs(motion.v).max(axis=0)
    for j in np.flatnonzero(fastest > _MOVES * max(float(fastest.max()), 1e-9)):
        use = log.valid
        q, v, a, tau = (x[use, j] for x in (motion.q, motion.v, motion.a, log.tau))
        joint, unit = log.joint_names[j], units[j]
        speed = "N m s/rad" if unit == "N m" else "N s/m"
        try:
            fit, at, torque = fit_steady(q, v, a, tau, ("viscous", "coulomb"), (speed, unit))
        except LogError as error:
            raise LogError(f"{log.file}, {joint}: {error}") from error
        moving = np.abs(v) > _MOVES * fastest[j]
        out.append(FrictionTest(joint, log.file, fit, at, torque, float(np.mean(_steady(v, a)[moving]))))
    if not out:
        raise LogError(f"{log.file}: no joint moves; record triangles of several speeds.")
    return tuple(out)
