"""Drive torque when a joint is not where it is thought to be: what effects of readings and transmissions share.

A *reading* that errs moves joint and motor together, so friction and rotor move too. A *link* that gives way moves
without its motor: friction and rotor stay where the encoder is.
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
    """Additional drive torque, to first order, where joint ``row`` is ``dq``, ``dv``, ``da`` beyond its reading."""
    out = _first_order(operation, row, dq, dv, da)
    out[:, row] += operation.robot.viscous_friction[row] * dv
    return out


def change_by_link(operation: Operation, row: int, dq: Samples, dv: Samples, da: Samples) -> Float[Array, "N nv"]:
    """Additional torque on the links, to first order, of a link that is ``dq``, ``dv``, ``da`` ahead of its motor."""
    out = _first_order(operation, row, dq, dv, da)
    out[:, row] -= operation.robot.rotor_inertia[row] * da
    return out


def _first_order(operation: Operation, row: int, dq: Samples, dv: Samples, da: Samples) -> Float[Array, "N nv"]:
    """Additional torque of links and rotors where joint ``row`` is ``dq``, ``dv``, ``da`` further."""
    to_q, to_v, mass = (part[:, :, row].T for part in operation.partials)
    # Into the same memory: half of the time would go into that of five arrays that live for one sum.
    out = to_q * dq
    more = to_v * dv
    out += more
    out += np.multiply(mass, da, out=more)
    return out.T


def exact_change_by_reading(
    robot: Robot, operation: Operation, row: int, dq: Samples, dv: Samples, da: Samples
) -> Float[Array, "N nv"]:
    """As `change_by_reading`, by inverse dynamics of the displaced motion, friction included."""
    return inverse_dynamics(robot, displaced(operation, row, dq, dv, da)) - inverse_dynamics(robot, operation)


def exact_change_by_link(
    robot: Robot, operation: Operation, row: int, dq: Samples, dv: Samples, da: Samples
) -> Float[Array, "N nv"]:
    """As `change_by_link`, by inverse dynamics of the displaced links."""
    return link_torque(robot, displaced(operation, row, dq, dv, da)) - link_torque(robot, operation)


def displaced(motion: Motion, row: int, dq: Samples, dv: Samples, da: Samples) -> Motion:
    """``motion`` with an offset added to one joint."""
    q, v, a = motion.q.copy(), motion.v.copy(), motion.a.copy()
    for values, change in ((q, dq), (v, dv), (a, da)):
        values[:, row] += change
    return motion.with_joints(q, v, a)


def load_and_inertia(operation: Operation, row: int) -> tuple[Samples, Samples]:
    """Torque that the transmission passes to the link, and the link's inertia, without its rotor, [kg m^2 or kg]."""
    inertia = operation.inertia[:, row] - operation.robot.rotor_inertia[row]
    return operation.transmitted[:, row], np.maximum(inertia, 1e-12)


def behind_encoder(robot: Robot, row: int) -> str | None:
    """Why effects behind the motor cannot be seen: the encoder is on the link's side. None where it is not."""
    if robot.actuators[row].encoder_side == "link":
        return "the encoder sits on the link's side: it never sees how far motor and link are apart"
    return None
