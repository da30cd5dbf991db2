# pyright: reportAttributeAccessIssue=false
"""Inverse kinematics of a biped: joint motion for given motions of the centre of mass and both soles.

Eighteen coordinates (the base and two legs of six joints) satisfy eighteen conditions: the centre of mass, an upright
base with a heading, and the poses of two soles. Velocities and accelerations are exact, without numerical
differentiation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from phantom_dyn.array_types import Array, Float, ReadOnlyArrays
from phantom_dyn.errors import ParameterError
from phantom_dyn.walking.divergent_component import PendulumState
from phantom_dyn.walking.pattern import FootMotion
from phantom_dyn.walking.walker import Walker

TOLERANCE = 1e-10
"""Residual [m and rad] at which Newton's method stops; its effect on the zero moment point is negligible."""
MAX_STEPS = 30
"""Largest number of Newton steps; from the solution at the previous sample three or four are enough."""
_WORLD = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


@dataclass(frozen=True)
class ComMotion:
    """Motion of the centre of mass [m, s]."""

    position: Float[Array, "N 3"]
    velocity: Float[Array, "N 3"]
    acceleration: Float[Array, "N 3"]


def com_above_slope(pendulum: PendulumState, height: float, slope: float) -> ComMotion:
    """Centre of mass of a planned pendulum, at a height [m] above a plane that rises by ``slope`` along x."""
    x, v, a = pendulum.com, pendulum.velocity, pendulum.acceleration
    return ComMotion(
        np.column_stack([x, height + slope * x[:, 0]]),
        np.column_stack([v, slope * v[:, 0]]),
        np.column_stack([a, slope * a[:, 0]]),
    )


@dataclass(frozen=True)
class WholeBodyMotion(ReadOnlyArrays):
    """Motion of a floating-base model in Pinocchio's coordinates."""

    q: Float[Array, "N nq"]
    v: Float[Array, "N nv"]
    a: Float[Array, "N nv"]


def whole_body_motion(walker: Walker, com: ComMotion, left: FootMotion, right: FootMotion) -> WholeBodyMotion:
    """Motion of base and legs; the other joints stay in the walker's posture.

    Args:
        walker: The biped.
        com: Motion of the centre of mass.
        left: Motion of the left sole.
        right: Motion of the right sole. The base has the mean heading of both soles.

    Raises:
        ParameterError: If a leg cannot reach its sole, or goes beyond a joint's limits.
    """
    model = walker.model
    data = model.createData()
    columns = list(walker.leg_columns)
    samples = len(com.position)
    q, v, a = np.zeros((samples, model.nq)), np.zeros((samples, model.nv)), np.zeros((samples, model.nv))
    configuration = np.array(walker.posture)
    for k in range(samples):
        base = _rotation((left.position[k, 3] + right.position[k, 3]) / 2)
        soles = [_sole(left.position[k]), _sole(right.position[k])]
        configuration = _solve(walker, data, configuration, com.position[k], base, soles, k)
        jacobian = _jacobian(model, data, configuration)[:, columns]
        q[k] = configuration
        v[k, columns] = np.linalg.solve(jacobian, _rates(com.velocity[k], left.velocity[k], right.velocity[k]))
        wanted = _rates(com.acceleration[k], left.acceleration[k], right.acceleration[k])
        a[k, columns] = np.linalg.solve(jacobian, wanted - _drift(model, data, configuration, v[k]))
    _check_limits(model, q)
    return WholeBodyMotion(q, v, a)


def _solve(
    walker: Walker, data: pin.Data, q: Array, com: Array, base: Array, soles: list[pin.SE3], sample: int
) -> Array:
    """Configuration near ``q`` that satisfies all conditions, by Newton's method."""
    model, columns = walker.model, list(walker.leg_columns)
    residual = _residual(model, data, q, com, base, soles)
    for _ in range(MAX_STEPS):
        if np.abs(residual).max() < TOLERANCE:
            return q
        step = np.zeros(model.nv)
        step[columns] = np.linalg.solve(_jacobian(model, data, q)[:, columns], residual)
        q = pin.integrate(model, q, step)
        residual = _residual(model, data, q, com, base, soles)
    raise ParameterError(
        f"No posture of the legs was found at sample {sample}, where {np.abs(residual).max():.1e} m or rad are left: "
        "give a slower or shorter step, or bend the knees more in the posture."
    )


def _residual(model: pin.Model, data: pin.Data, q: Array, com: Array, base: Array, soles: list[pin.SE3]) -> Array:
    """Errors of centre of mass, base and soles, shape ``(18,)``; rotations as rotation vectors in world axes."""
    pin.framesForwardKinematics(model, data, q)
    parts = [com - pin.centerOfMass(model, data, q), pin.log3(base @ data.oMi[1].rotation.T)]
    for name, wanted in zip(("left_sole", "right_sole"), soles, strict=True):
        pose = data.oMf[model.getFrameId(name)]
        parts += [wanted.translation - pose.translation, pin.log3(wanted.rotation @ pose.rotation.T)]
    return np.concatenate(parts)


def _jacobian(model: pin.Model, data: pin.Data, q: Array) -> Array:
    """Jacobian of the quantities of `_rates`, in world axes, shape ``(18, nv)``."""
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    rows = [pin.jacobianCenterOfMass(model, data, q, False)]
    rows.append(pin.getJointJacobian(model, data, 1, _WORLD)[3:])
    rows += [pin.getFrameJacobian(model, data, model.getFrameId(name), _WORLD) for name in ("left_sole", "right_sole")]
    return np.vstack(rows)


def _drift(model: pin.Model, data: pin.Data, q: Array, v: Array) -> Array:
    """Accelerations at zero joint acceleration, in the order of `_rates`."""
    rest = np.zeros(model.nv)
    pin.centerOfMass(model, data, q, v, rest)
    parts = [data.acom[0].copy()]
    pin.forwardKinematics(model, data, q, v, rest)
    pin.updateFramePlacements(model, data)
    parts.append(pin.getClassicalAcceleration(model, data, 1, _WORLD).angular)
    for name in ("left_sole", "right_sole"):
        index = model.getFrameId(name)
        parts.append(pin.getFrameClassicalAcceleration(model, data, index, _WORLD).vector)
    return np.concatenate(parts)


def _rates(com: Array, left: Array, right: Array) -> Array:
    """Velocities or accelerations in world axes: centre of mass, rotation of the base, motion of each sole."""
    turn = np.array([0.0, 0.0, (left[3] + right[3]) / 2])
    soles = [np.concatenate([foot[:3], [0.0, 0.0, foot[3]]]) for foot in (left, right)]
    return np.concatenate([com, turn, *soles])


def _rotation(heading: float) -> Array:
    return pin.utils.rotate("z", float(heading))


def _sole(pose: Array) -> pin.SE3:
    return pin.SE3(_rotation(pose[3]), pose[:3].copy())


def _check_limits(model: pin.Model, q: Array) -> None:
    """Refuse a motion beyond the limits of a joint."""
    outside = (q < model.lowerPositionLimit - 1e-9) | (q > model.upperPositionLimit + 1e-9)
    outside[:, :7] = False
    if outside.any():
        sample, entry = np.argwhere(outside)[0]
        name = next(n for n, j in zip(model.names, model.joints, strict=True) if j.nq == 1 and j.idx_q == entry)
        raise ParameterError(
            f"{name} is at {q[sample, entry]:.3f} rad at sample {sample}, beyond its limits "
            f"[{model.lowerPositionLimit[entry]:.3f}, {model.upperPositionLimit[entry]:.3f}]: "
            "give a slower or shorter step, or another posture."
        )
