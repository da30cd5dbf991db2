"""The robot with estimated parameters as arrays, for the compiled simulation of a closed loop."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from identification.regression.base_parameters import BaseParameters
from identification.regression.regressor import Regressor, RegressorTerm, term_columns
from phantom_dyn._kernels.single_state import BODY, Chain, at_root, chain_of, joint_rows
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.dynamics import standard_parameters
from phantom_dyn.errors import ParameterError
from phantom_dyn.loops.solver import loop_closure_of
from phantom_dyn.model.robot import Robot


class Plant(NamedTuple):
    """The robot in a closed loop as arrays for the compiled steps; ``nt`` joints of the tree, ``nv`` active ones.

    Attributes:
        joint_constants: Constants of each joint of the tree, root first, from
            `phantom_dyn._kernels.single_state.joint_rows`.
        joint_indices: Parent, kind and velocity index of each joint, from the same function.
        root: Motion of the root from `phantom_dyn._kernels.single_state.at_root`; the simulation copies it.
        chain: Map from the motion of the active joints to that of all joints of the tree. It contains no friction.
        rotor: Rotor inertia that is added to the mass matrix, ``(nv, nv)``.
        passive: Indices of the passive joints in the tree, ``(ne - nv,)``.
        J_friction: Jacobian from the velocities of the active joints to those of the joints with friction,
            ``(ne, nv)``. The first ``nv`` rows are the active joints; the rows of the passive ones are overwritten at
            every state.
        friction: Parameters of each joint with friction, ``(ne, 5)``: Coulomb torque, additional torque at standstill
            (Stribeck), Stribeck velocity, viscous coefficients forward and backward.
        constant_torque: Constant torques on the joints, ``(nv,)``.
        stiffness: Stiffness of springs at the joints, which have no torque at position zero, ``(nv,)``.
    """

    joint_constants: Array
    joint_indices: Array
    root: Array
    chain: Chain
    rotor: Array
    passive: Array
    J_friction: Array
    friction: Array
    constant_torque: Array
    stiffness: Array

    @property
    def bodies(self) -> Float[Array, "nt 10"]:
        """Ten parameters of each body, a view into ``joint_constants``."""
        return self.joint_constants[1:, BODY:]


def plant_of(regressor: Regressor, base: BaseParameters, theta: Float[Array, " r"]) -> Plant:
    """The robot with the given base parameters, for the compiled simulation.

    Dependent parameters have the values of the model: its inertial parameters, and zero for effects.

    Args:
        regressor: The equations, with robot and terms.
        base: Base parameters: the independent columns, and how the dependent ones are grouped with them.
        theta: Values of the base parameters.

    Raises:
        ParameterError: If a term has no law in the compiled simulation.
    """
    full = all_parameters(regressor, base, theta)
    plant = _plant_of_model(regressor.robot)
    if regressor.rigid_body:
        plant.bodies[:] = full[: regressor.first_effect].reshape(-1, 10)
    for term, columns in zip(regressor.terms, term_columns(regressor), strict=True):
        _law_of(term)(plant, regressor.robot, term, full[list(columns)])
    return plant


def all_parameters(regressor: Regressor, base: BaseParameters, theta: Float[Array, " r"]) -> Float[Array, " p"]:
    """Values of all parameters for the given base parameters; dependent ones have the values of the model.

    Args:
        regressor: The equations, with robot and columns.
        base: Base parameters: the independent columns, and how the dependent ones are grouped with them.
        theta: Values of the base parameters.
    """
    full = model_parameters(regressor)
    independent, dependent = list(base.independent), list(base.dependent)
    full[independent] = theta - base.grouping @ full[dependent]
    return full


def model_parameters(regressor: Regressor) -> Float[Array, " p"]:
    """Values of all parameters in the given model: standard parameters of its links, and zero for the effects."""
    full = np.zeros(len(regressor.names))
    if regressor.rigid_body:
        full[: regressor.first_effect] = standard_parameters(regressor.robot)
    return full


def require_simulable(regressor: Regressor) -> None:
    """Raise an error, before anything is computed, if the compiled simulation lacks one of the effects.

    Args:
        regressor: The equations, with robot and terms.

    Raises:
        ParameterError: If a term has no law in the compiled simulation.
    """
    for term in regressor.terms:
        _law_of(term)


def _law_of(term: RegressorTerm) -> Callable[[Plant, Robot, RegressorTerm, Array], None]:
    """The function that adds the effect of a term to a plant."""
    name = term.effect.name
    if name not in _LAWS:
        raise ParameterError(
            f"The simulation of the closed loop has no law for {name}: leave it out, or use an estimator without "
            f"simulation, such as wls; it knows {', '.join(_LAWS)}."
        )
    return _LAWS[name]


def _plant_of_model(robot: Robot) -> Plant:
    """The given model without changes, as arrays that may be written to."""
    chain = robot.chain
    nt, nv = robot.model.nv, robot.nv
    passive = [] if chain is None else list(chain.passive)
    friction = np.zeros((nt, 5))
    friction[:, 2] = 1.0
    friction[:nv, 0] = robot.coulomb_friction
    friction[:nv, 3] = friction[:nv, 4] = robot.viscous_friction
    if chain is not None:
        friction[nv:, 0] = chain.coulomb_friction
        friction[nv:, 3] = friction[nv:, 4] = chain.viscous_friction
    joint_constants, joint_indices = joint_rows(robot.arrays)
    return Plant(
        joint_constants=joint_constants,
        joint_indices=joint_indices,
        root=at_root(len(joint_indices), robot.model.gravity.linear),
        chain=_chain_without_friction(robot),
        rotor=np.diag(robot.rotor_inertia),
        passive=np.array(passive, dtype=np.int64),
        J_friction=np.concatenate([np.eye(nv), np.zeros((nt - nv, nv))]),
        friction=friction,
        constant_torque=np.zeros(nv),
        stiffness=np.zeros(nv),
    )


def _chain_without_friction(robot: Robot) -> Chain:
    """Map from the motion of the active joints to that of the tree. Friction is zero, as `Plant.friction` has it."""
    chain, nt = robot.chain, robot.model.nv
    zeros, rotor = np.zeros(nt), np.zeros(nt)
    if chain is None:
        return chain_of(np.eye(nt), zeros, zeros, zeros, rotor)
    passive = list(chain.passive)
    rotor[passive] = robot.model.armature[passive]
    loops = loop_closure_of(robot.model, chain, robot.arrays)
    return chain_of(chain.linear_map[:, : chain.nv], chain.offset, zeros, zeros, rotor, loops)


def _row(robot: Robot, joint: str | None) -> int:
    """Index of a joint among those with friction: active ones, then passive ones."""
    return [*robot.joint_names, *robot.passive_names].index(joint or "")


def _viscous(plant: Plant, robot: Robot, term: RegressorTerm, theta: Array) -> None:
    """Add a viscous coefficient, forward and backward."""
    plant.friction[_row(robot, term.joint), 3:] += theta[0]


def _coulomb(plant: Plant, robot: Robot, term: RegressorTerm, theta: Array) -> None:
    """Add a Coulomb torque."""
    plant.friction[_row(robot, term.joint), 0] += theta[0]


def _stribeck(plant: Plant, robot: Robot, term: RegressorTerm, theta: Array) -> None:
    """Add a Coulomb torque and an additional torque at standstill; replace the Stribeck velocity, which is 1 before."""
    plant.friction[_row(robot, term.joint), :3] += [theta[0], theta[1], term.shape[0] - 1.0]


def _directions(plant: Plant, robot: Robot, term: RegressorTerm, theta: Array) -> None:
    """Add Coulomb torques forward and backward, as their mean and a constant torque, and viscous coefficients."""
    row = _row(robot, term.joint)
    plant.friction[row, 0] += 0.5 * (theta[0] + theta[1])
    plant.constant_torque[row] -= 0.5 * (theta[0] - theta[1])
    plant.friction[row, 3:] += theta[2:]


def _offset(plant: Plant, robot: Robot, term: RegressorTerm, theta: Array) -> None:
    """Add a constant torque."""
    plant.constant_torque[_row(robot, term.joint)] += theta[0]


def _rotor(plant: Plant, robot: Robot, term: RegressorTerm, theta: Array) -> None:
    """Add a rotor inertia."""
    row = _row(robot, term.joint)
    plant.rotor[row, row] += theta[0]


def _spring(plant: Plant, robot: Robot, term: RegressorTerm, theta: Array) -> None:
    """Add the stiffness of a spring, and its torque at position zero as a constant torque."""
    row = _row(robot, term.joint)
    plant.stiffness[row] += theta[0]
    plant.constant_torque[row] -= theta[1]


def _bodies(plant: Plant, robot: Robot, term: RegressorTerm, theta: Array) -> None:
    """Add changes of inertial parameters."""
    body, parameter = np.divmod(term.effect.regressor_columns(robot, term.joint), 10)
    plant.bodies[body, parameter] += theta


# Functions that add the effect of a term with the coefficients ``theta`` to a plant, by the name of the effect.
_LAWS: dict[str, Callable[[Plant, Robot, RegressorTerm, Array], None]] = {
    "viscous_friction": _viscous,
    "coulomb_friction": _coulomb,
    "direction_dependent_friction": _directions,
    "stribeck_friction": _stribeck,
    "torque_offset": _offset,
    "rotor_inertia": _rotor,
    "parasitic_spring": _spring,
    "payload": _bodies,
    "inertial_parameters": _bodies,
}
