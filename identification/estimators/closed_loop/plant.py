"""A robot with parameters that are being estimated, as arrays that a compiled simulation takes."""

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
        numbers: The joints of the tree, root first, as `phantom_dyn._kernels.single_state.joint_rows` gives them.
        places: The same.
        root: Motion of the root from `phantom_dyn._kernels.single_state.at_root`; copied before it is used.
        chain: How the tree follows the active joints; friction of the passive ones is in ``dry`` instead.
        rotor: What rotors on the active joints add to the mass matrix, ``(nv, nv)``.
        passive: Places of the passive joints in the tree, ``(ne - nv,)``.
        E: Speed of each rubbing joint per velocity of the active ones, ``(ne, nv)``; the first ``nv`` rows are the
            active joints themselves, and those of the passive ones are overwritten at every state.
        dry: Friction of each rubbing joint: level at speed, what it is higher by at rest, velocity over which that
            fades, viscous coefficient forward, backward, ``(ne, 5)``.
        push: Constant torques on the joints, ``(nv,)``.
        spring: Stiffness of springs at the joints, at rest at zero, ``(nv,)``.
    """

    numbers: Array
    places: Array
    root: Array
    chain: Chain
    rotor: Array
    passive: Array
    E: Array
    dry: Array
    push: Array
    spring: Array

    @property
    def bodies(self) -> Float[Array, "nt 10"]:
        """Ten parameters of each body, a view into ``numbers``."""
        return self.numbers[1:, BODY:]


def plant_of(regressor: Regressor, base: BaseParameters, theta: Float[Array, " r"]) -> Plant:
    """The robot with these base parameters: what regroups stays as the model has it, effects that regroup are none.

    Args:
        regressor: Gives robot and terms.
        base: How the parameters regroup.
        theta: Their values.

    Raises:
        ParameterError: If a term has no law in the compiled simulation.
    """
    full = all_parameters(regressor, base, theta)
    plant = _given(regressor.robot)
    if regressor.rigid_body:
        plant.bodies[:] = full[: regressor.first_effect].reshape(-1, 10)
    for term, columns in zip(regressor.terms, term_columns(regressor), strict=True):
        _laws(term)(plant, regressor.robot, term, full[list(columns)])
    return plant


def all_parameters(regressor: Regressor, base: BaseParameters, theta: Float[Array, " r"]) -> Float[Array, " p"]:
    """Values of all columns that have the given base parameters; those that regroup are the model's.

    Args:
        regressor: Gives robot and columns.
        base: How the parameters regroup.
        theta: Base parameters.
    """
    full = model_parameters(regressor)
    kept, rest = list(base.independent), list(base.dependent)
    full[kept] = theta - base.grouping @ full[rest]
    return full


def model_parameters(regressor: Regressor) -> Float[Array, " p"]:
    """Values of all columns in the given model, which has none of the effects."""
    full = np.zeros(len(regressor.names))
    if regressor.rigid_body:
        full[: regressor.first_effect] = standard_parameters(regressor.robot)
    return full


def require_simulable(regressor: Regressor) -> None:
    """Refuse what the compiled simulation does not know, before anything is computed.

    Args:
        regressor: Gives robot and terms.

    Raises:
        ParameterError: If a term has no law in the compiled simulation.
    """
    for term in regressor.terms:
        _laws(term)


def _laws(term: RegressorTerm) -> Callable[[Plant, Robot, RegressorTerm, Array], None]:
    name = term.effect.name
    if name not in _LAWS:
        raise ParameterError(
            f"The simulation of the closed loop has no law for {name}: leave it out, or use an estimator without "
            f"simulation, such as wls; it knows {', '.join(_LAWS)}."
        )
    return _LAWS[name]


def _given(robot: Robot) -> Plant:
    """The model as it is; its arrays may be written to."""
    chain = robot.chain
    nt, nv = robot.model.nv, robot.nv
    passive = [] if chain is None else list(chain.passive)
    dry = np.zeros((nt, 5))
    dry[:, 2] = 1.0
    dry[:nv, 0] = robot.coulomb_friction
    dry[:nv, 3] = dry[:nv, 4] = robot.viscous_friction
    if chain is not None:
        dry[nv:, 0] = chain.coulomb_friction
        dry[nv:, 3] = dry[nv:, 4] = chain.viscous_friction
    numbers, places = joint_rows(robot.arrays)
    return Plant(
        numbers=numbers,
        places=places,
        root=at_root(len(places), robot.model.gravity.linear),
        chain=_followed(robot),
        rotor=np.diag(robot.rotor_inertia),
        passive=np.array(passive, dtype=np.int64),
        E=np.concatenate([np.eye(nv), np.zeros((nt - nv, nv))]),
        dry=dry,
        push=np.zeros(nv),
        spring=np.zeros(nv),
    )


def _followed(robot: Robot) -> Chain:
    """Motion of the tree for that of the active joints; friction of the passive ones is added elsewhere."""
    chain, nt = robot.chain, robot.model.nv
    none, rotor = np.zeros(nt), np.zeros(nt)
    if chain is None:
        return chain_of(np.eye(nt), none, none, none, rotor)
    passive = list(chain.passive)
    rotor[passive] = robot.model.armature[passive]
    loops = loop_closure_of(robot.model, chain, robot.arrays)
    return chain_of(chain.linear_map[:, : chain.nv], chain.offset, none, none, rotor, loops)


def _row(robot: Robot, joint: str | None) -> int:
    """Index of a joint among those with friction: active ones, then passive ones."""
    return [*robot.joint_names, *robot.passive_names].index(joint or "")


def _viscous(plant: Plant, robot: Robot, term: RegressorTerm, c: Array) -> None:
    plant.dry[_row(robot, term.joint), 3:] += c[0]


def _coulomb(plant: Plant, robot: Robot, term: RegressorTerm, c: Array) -> None:
    plant.dry[_row(robot, term.joint), 0] += c[0]


def _stribeck(plant: Plant, robot: Robot, term: RegressorTerm, c: Array) -> None:
    plant.dry[_row(robot, term.joint), :3] += [c[0], c[1], term.shape[0] - 1.0]


def _directions(plant: Plant, robot: Robot, term: RegressorTerm, c: Array) -> None:
    row = _row(robot, term.joint)
    plant.dry[row, 0] += 0.5 * (c[0] + c[1])
    plant.push[row] -= 0.5 * (c[0] - c[1])
    plant.dry[row, 3:] += c[2:]


def _offset(plant: Plant, robot: Robot, term: RegressorTerm, c: Array) -> None:
    plant.push[_row(robot, term.joint)] += c[0]


def _rotor(plant: Plant, robot: Robot, term: RegressorTerm, c: Array) -> None:
    row = _row(robot, term.joint)
    plant.rotor[row, row] += c[0]


def _spring(plant: Plant, robot: Robot, term: RegressorTerm, c: Array) -> None:
    row = _row(robot, term.joint)
    plant.spring[row] += c[0]
    plant.push[row] -= c[1]


def _bodies(plant: Plant, robot: Robot, term: RegressorTerm, c: Array) -> None:
    body, parameter = np.divmod(term.effect.regressor_columns(robot, term.joint), 10)
    plant.bodies[body, parameter] += c


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
