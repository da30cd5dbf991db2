"""Change of the drive torque if the true position of a joint differs from its encoder reading.

If the *reading* is wrong, motor and link are both displaced from the reading, so that the torques of friction and rotor
change too. If an elastic transmission displaces the *link*, the motor is at the reading, so that friction and rotor
torque do not change. Displacements ``dq``, ``dv``, ``da`` are true minus read position, velocity and acceleration of
one joint.
"""

from __future__ import annotations

import numpy as np

from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.dynamics import inverse_dynamics, link_torque
from phantom_dyn.effects.operation import Operation
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion

Samples = Float[Array, " N"]


def change_by_reading(operation: Operation, row: int, dq: Samples, dv: Samples, da: Samples) -> Float[Array, "N nv"]:
    """First-order change of the drive torque if joint ``row`` is displaced by ``dq``, ``dv``, ``da``."""
    out = _first_order(operation, row, dq, dv, da)
    out[:, row] += operation.robot.viscous_friction[row] * dv
    return out


def change_by_link(operation: Operation, row: int, dq: Samples, dv: Samples, da: Samples) -> Float[Array, "N nv"]:
    """First-order change of the link torque if link ``row`` is displaced by ``dq``, ``dv``, ``da``."""
    out = _first_order(operation, row, dq, dv, da)
    out[:, row] -= operation.robot.rotor_inertia[row] * da
    return out


def _first_order(operation: Operation, row: int, dq: Samples, dv: Samples, da: Samples) -> Float[Array, "N nv"]:
    """First-order change of the torque of links and rotors if joint ``row`` is displaced."""
    to_q, to_v, mass = (part[:, :, row].T for part in operation.partials)
    # In place, because allocating an array for each term would take as long as the sum.
    out = to_q * dq
    term = to_v * dv
    out += term
    out += np.multiply(mass, da, out=term)
    return out.T


def exact_change_by_reading(
    robot: Robot, operation: Operation, row: int, dq: Samples, dv: Samples, da: Samples
) -> Float[Array, "N nv"]:
    """Change of the drive torque, with friction, from inverse dynamics of the displaced motion."""
    return inverse_dynamics(robot, displaced(operation, row, dq, dv, da)) - inverse_dynamics(robot, operation)


def exact_change_by_link(
    robot: Robot, operation: Operation, row: int, dq: Samples, dv: Samples, da: Samples
) -> Float[Array, "N nv"]:
    """Change of the link torque from inverse dynamics of the displaced links."""
    return link_torque(robot, displaced(operation, row, dq, dv, da)) - link_torque(robot, operation)


def displaced(motion: Motion, row: int, dq: Samples, dv: Samples, da: Samples) -> Motion:
    """``motion`` with ``dq``, ``dv``, ``da`` added to position, velocity and acceleration of joint ``row``."""
    q, v, a = motion.q.copy(), motion.v.copy(), motion.a.copy()
    for values, change in ((q, dq), (v, dv), (a, da)):
        values[:, row] += change
    return motion.with_joints(q, v, a)


def load_and_inertia(operation: Operation, row: int) -> tuple[Samples, Samples]:
    """Torque through the transmission [N m or N], and inertia of the link without its rotor [kg m^2 or kg]."""
    inertia = operation.inertia[:, row] - operation.robot.rotor_inertia[row]
    return operation.transmitted[:, row], np.maximum(inertia, 1e-12)


def behind_encoder(robot: Robot, row: int) -> str | None:
    """Reason why an encoder on the link's side hides effects of the transmission; None if it is elsewhere."""
    if robot.actuators[row].encoder_side == "link":
        return "the encoder sits on the link's side: it never sees how far motor and link are apart"
    return None
