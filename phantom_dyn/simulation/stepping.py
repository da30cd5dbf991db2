# pyright: reportAttributeAccessIssue=false
r"""One simulation step of a robot with dry friction and elastic transmissions.

The step is the midpoint rule for velocities: :math:`(A + \tfrac{h}{2} D)\,(v^+ - v) = h\,(f - D v) + \lambda`. The
positions :math:`x` with velocities :math:`v` are those of the joints, followed by those of the motors on elastic
transmissions. The inertia :math:`A` and the forces :math:`f` are evaluated half a step ahead; :math:`D` is viscous
friction. The impulse :math:`|\lambda_j| \le h T_j` of Coulomb friction opposes :math:`v^+_j`, so a joint at rest
sticks. The rule is of second order for smooth motion.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import pinocchio as pin

from phantom_dyn._kernels.dry_friction import FrictionPlaces, apply_dry_friction, friction_on_motors
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.dynamics import body_torque_of_tree, link_torque, mass_matrix, mass_matrix_of_tree
from phantom_dyn.dynamics.tree_motion import passive_friction, tree_motion
from phantom_dyn.effects.simulated import Transmission
from phantom_dyn.effects.support.rows import row_of
from phantom_dyn.errors import ParameterError
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import BaseMotion, Motion
from phantom_dyn.simulation.compiled.arm_steps import spring_torque

Torques = Callable[[float, Array, Array, Array], tuple[Array, Array]]
"""Drive torque and the effects' torques, shape (nv,) each, from time, positions and velocities, transmitted torque."""
# Phase by which the fastest transmission oscillates in one step [rad]; the error of its frequency is then 0.1 %.
_PHASE_PER_STEP = 0.15


@dataclass(frozen=True)
class Machine:
    """A robot whose joints in ``loose`` have elastic transmissions.

    Attributes:
        robot: True rigid-body model with true friction.
        loose: Rows of the joints with elastic transmissions.
        stiffness: Stiffness of these transmissions, shape ``(m,)``.
        damping: Damping of these transmissions, shape ``(m,)``.
        gap: Backlash of these transmissions, shape ``(m,)``.
        coupled: Inertia on the motors' side in addition to the rotors, shape ``(nv, nv)``.
        workspace: Pinocchio's working memory. Each step writes to it, so a machine takes one simulation at a time.
    """

    robot: Robot
    loose: tuple[int, ...]
    stiffness: Float[Array, " m"]
    damping: Float[Array, " m"]
    gap: Float[Array, " m"]
    coupled: Float[Array, "nv nv"]
    workspace: pin.Data = field(repr=False, compare=False)

    # Cached, because every step needs these functions of the fields.
    @cached_property
    def nv(self) -> int:
        """Number of joints."""
        return self.robot.nv

    @cached_property
    def rotor(self) -> Float[Array, " nv"]:
        """Rotor inertia of each joint."""
        return self.robot.rotor_inertia

    @cached_property
    def drives(self) -> tuple[int, ...]:
        """Index of each joint's motor in ``x``: the index of the joint, or one after all joints if it is elastic."""
        nv = self.robot.nv
        return tuple(nv + self.loose.index(j) if j in self.loose else j for j in range(nv))

    @cached_property
    def friction_places(self) -> FrictionPlaces:
        """Places of dry friction, which are the motors."""
        return friction_on_motors(np.array(self.drives), self.nv + len(self.loose))

    @cached_property
    def encoders(self) -> tuple[int, ...]:
        """Index in ``x`` of the position that each joint's encoder measures, motor or link."""
        sides = [actuator.encoder_side for actuator in self.robot.actuators]
        return tuple(self.drives[j] if side == "motor" else j for j, side in enumerate(sides))


@dataclass(frozen=True)
class State:
    """State of the joints, followed by the motors on elastic transmissions.

    Attributes:
        x: Positions, shape ``(nv + m,)``.
        v: Velocities, shape ``(nv + m,)``.
        a: Mean accelerations of the last step, shape ``(nv + m,)``.
        transmitted: Torque that the transmissions pass to the links, shape ``(nv,)``.
        tree: Positions of the tree of a closed chain in the last step, from which the search for the next positions
            starts. None before the first step and without a closed chain.
    """

    x: Float[Array, " n"]
    v: Float[Array, " n"]
    a: Float[Array, " n"]
    transmitted: Float[Array, " nv"]
    tree: Float[Array, " nt"] | None = None


def machine_of(
    robot: Robot, transmissions: tuple[Transmission, ...], inertias: tuple[Float[Array, "nv nv"], ...] = ()
) -> Machine:
    """Machine with elastic transmissions and with additional inertias on the motors' side.

    Several transmissions on one joint are combined: the sum of their gaps and the softest spring apply.

    Raises:
        ParameterError: If a motor on an elastic transmission has no inertia.
    """
    rows = tuple(sorted({row_of(robot, part.joint) for part in transmissions}))
    parts = [[part for part in transmissions if row_of(robot, part.joint) == row] for row in rows]
    for row in rows:
        if not robot.rotor_inertia[row] > 0:
            raise ParameterError(
                f"Joint {robot.joint_names[row]} has no rotor inertia: a motor that is not rigidly tied to its link "
                f"needs one, give joints.{robot.joint_names[row]}.rotor_inertia in robot.yaml."
            )
    softest = [min(part, key=lambda one: one.stiffness) for part in parts]
    return Machine(
        robot,
        rows,
        np.array([part.stiffness for part in softest]),
        np.array([part.damping for part in softest]),
        np.array([sum(one.gap for one in part) for part in parts]),
        sum(inertias, np.zeros((robot.nv, robot.nv))),
        robot.model.createData(),
    )


def longest_step(machine: Machine, q: Float[Array, " nv"]) -> float:
    """Longest step [s] that resolves the oscillation of elastic transmissions; infinite if all are rigid."""
    if not machine.loose:
        return np.inf
    rows = list(machine.loose)
    rotor = machine.robot.rotor_inertia[rows]
    link = np.diag(mass_matrix(machine.robot, q[None])[0])[rows] - rotor
    return _PHASE_PER_STEP / float(np.sqrt(np.max(machine.stiffness * (1.0 / rotor + 1.0 / link))))


def in_balance(
    machine: Machine, q: Float[Array, " nv"], v: Float[Array, " nv"], base: BaseMotion | None = None
) -> State:
    """State at link positions ``q`` and velocities ``v``; transmissions carry the load of links at constant speed."""
    rows = list(machine.loose)
    links = Motion(np.zeros(1), q[None], v[None], np.zeros((1, len(q))), base=base)
    load = link_torque(machine.robot, links)[0]
    ahead = load[rows] / machine.stiffness + 0.5 * machine.gap * np.sign(load[rows])
    x, speed = np.concatenate([q, q[rows] + ahead]), np.concatenate([v, v[rows]])
    return State(x, speed, np.zeros(len(x)), load)


def with_motors(machine: Machine, state: State, q: Float[Array, " nv"], v: Float[Array, " nv"]) -> State:
    """The state with the motors on elastic transmissions at positions ``q`` and velocities ``v``, ``(nv,)`` each."""
    nv, rows = machine.nv, list(machine.loose)
    x, speed = np.concatenate([state.x[:nv], q[rows]]), np.concatenate([state.v[:nv], v[rows]])
    transmitted = state.transmitted.copy()
    transmitted[rows] = _spring_torque(machine, x, speed)
    return replace(state, x=x, v=speed, transmitted=transmitted)


def stepped(
    machine: Machine, state: State, t: float, h: float, torques: Torques, base: BaseMotion | None = None
) -> State:
    """The state after one step of ``h`` seconds from time ``t``; ``base``: motion of the base half a step ahead."""
    robot, nv, drives = machine.robot, machine.nv, list(machine.drives)
    x, v = state.x + 0.5 * h * state.v, state.v + 0.5 * h * state.a
    inertia, bias, tree = _links(machine, x[:nv], v[:nv], state.tree, base)
    spring = _spring_torque(machine, x, v)
    delivered, added = torques(t + 0.5 * h, x, v, state.transmitted)

    force = np.zeros(len(x))
    force[:nv] = -bias
    force[drives] += delivered + added
    force[list(machine.loose)] += spring
    force[nv:] -= spring
    viscous = np.zeros(len(x))
    viscous[drives] = robot.viscous_friction

    mobility = np.linalg.inv(inertia + np.diag(0.5 * h * viscous))
    speed = state.v + mobility @ (h * (force - viscous * state.v))
    dry = np.zeros(nv)
    apply_dry_friction(mobility, speed, machine.friction_places, dry, robot.coulomb_friction, h)
    a = (speed - state.v) / h
    transmitted = delivered + added - machine.rotor * a[:nv] - robot.viscous_friction * speed[drives] + dry
    transmitted[list(machine.loose)] = spring
    return State(x + 0.5 * h * speed, speed, a, transmitted, tree)


def _links(
    machine: Machine,
    q: Float[Array, " nv"],
    v: Float[Array, " nv"],
    near: Float[Array, " nt"] | None,
    base: BaseMotion | None,
) -> tuple[Float[Array, "n n"], Float[Array, " nv"], Float[Array, " nt"] | None]:
    """Mass matrix of joints and motors, link torque at zero acceleration, and ``State.tree``."""
    robot, nv, rows = machine.robot, machine.nv, list(machine.loose)
    if robot.chain is None and base is None:
        # Pinocchio is the fastest for one state at a time.
        configuration = q if robot.model.nq == nv else robot.configuration(q[None])[0]
        upper = pin.crba(robot.model, machine.workspace, configuration)
        mass = np.where(np.tri(nv, dtype=bool).T, upper, upper.T)
        bias = pin.nonLinearEffects(robot.model, machine.workspace, configuration, v)
        tree_positions = None
    else:
        tree = tree_motion(robot, Motion(np.zeros(1), q[None], v[None], np.zeros((1, nv)), base=base), near=near)
        mass, tree_positions = mass_matrix_of_tree(robot, tree)[0], tree.q[0]
        bias = body_torque_of_tree(robot, tree)[0] + passive_friction(robot, tree)[0]
    out = np.zeros((nv + len(rows), nv + len(rows)))
    out[:nv, :nv] = mass
    rotor = machine.rotor[rows]
    # On an elastic transmission, the rotor belongs to the motor and not to the joint.
    out[rows, rows] -= rotor
    motors = np.arange(nv, len(out))
    out[motors, motors] = rotor
    out[np.ix_(machine.drives, machine.drives)] += machine.coupled
    return out, bias, tree_positions


def _spring_torque(machine: Machine, x: Float[Array, " n"], v: Float[Array, " n"]) -> Float[Array, " m"]:
    """Torque of elastic transmissions on their links, see `spring_torque`."""
    nv, rows = machine.nv, list(machine.loose)
    numbers = machine.stiffness, machine.damping, machine.gap
    each = zip(x[nv:] - x[rows], v[nv:] - v[rows], *numbers, strict=True)
    return np.array([spring_torque(*one) for one in each], dtype=float)
