"""Parameters of the model that may change within its stated tolerances, and the column of each in the regression.

They are nuisances: fits include them, but torque that they explain is no error of the model beyond its tolerances.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from identification.data.floating.base_errors import SENSOR_ERRORS, torque_per_base_error
from identification.data.log import Log
from identification.diagnosis.columns.motion.soft_friction import soft_joints, softness
from phantom_dyn.array_types import Array, Float
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.support.rows import modelled_friction_of
from phantom_dyn.model.inertia import tolerance_directions
from phantom_dyn.model.robot import Robot

TIMING = "timing"
"""Kind of the parameter that shifts all torques in time."""
SOFTNESS = "softness"
"""Kind of the softness of dry friction: soft friction changes sign gradually, as in MuJoCo."""
ARRIVAL = "arrival"
"""Kind of the time at which a joint's references arrive within a cycle of the controller."""
BASE = "base"
"""Kind of an error of the sensors on a base that is not bolted down."""
RECORDING_KINDS = (TIMING, SOFTNESS, ARRIVAL, BASE)
"""Kinds of parameters that belong to a recording, and not to the model."""


@dataclass(frozen=True)
class ToleranceParameter:
    """A parameter that may change within its tolerance: it has a zero-mean Gaussian prior and a bound.

    Attributes:
        name: Name of the changed quantity in the report.
        sigma: Standard deviation of the change.
        bound: Largest change.
        kind: Inertial parameters of a body, friction or rotor of a joint, softness of its friction, arrival of its
            references, an error of the base's sensors, or the timing of all torques.
        owner: Index of the body, or name of the joint or of the error, to which it belongs; None for the timing.
        direction: Direction of the change in the ten inertial parameters of the body.
        relative: True if the change is relative to the modelled value. Otherwise the unit depends on the kind: samples
            for shifts of torques or references, shares of MuJoCo's law for softness, SI units for errors of the base's
            sensors.
    """

    name: str
    sigma: float
    bound: float
    kind: str
    owner: int | str | None
    direction: Float[Array, " 10"] | None = None
    relative: bool = True


def bodies_on(robot: Robot, row: int) -> tuple[int, ...]:
    """Bodies that the drive of a joint moves, in Pinocchio's order: the joint's subtree, or all in a closed chain."""
    if robot.chain is not None:
        return tuple(range(1, robot.model.njoints))
    return tuple(sorted(robot.model.subtrees[robot.model.getJointId(robot.joint_names[row])]))


def parameters_by_joint(robot: Robot, parameters: tuple[ToleranceParameter, ...]) -> tuple[tuple[int, ...], ...]:
    """For each joint, indices of the parameters that may change its torque.

    Parameters of a passive joint may change the torque of all joints. The subtree of a joint is read from Pinocchio
    once per joint, as this takes most of the time.
    """
    # True for parameters of one body, by its index, or of one active joint, by its name.
    local = [isinstance(parameter.owner, int) or parameter.owner in robot.joint_names for parameter in parameters]
    out = []
    for row, joint in enumerate(robot.joint_names):
        moved = {*bodies_on(robot, row), joint}
        out.append(tuple(k for k, parameter in enumerate(parameters) if parameter.owner in moved or not local[k]))
    return tuple(out)


def tolerance_parameters(robot: Robot) -> tuple[ToleranceParameter, ...]:
    """All parameters of a robot that may change within its tolerances."""
    out: list[ToleranceParameter] = []
    tolerance = robot.tolerance
    if tolerance.inertia > 0:
        for body in range(1, robot.model.njoints):
            directions, names = tolerance_directions(robot, body)
            for k, name in enumerate(names):
                if np.any(directions[:, k]):
                    sigma = tolerance.inertia
                    out.append(ToleranceParameter(name, sigma, 2 * sigma, "body", body, directions[:, k]))
    of_joints = (
        ("viscous", "viscous friction", tolerance.friction),
        ("coulomb", "Coulomb friction", tolerance.friction),
        ("rotor", "rotor inertia", tolerance.rotor_inertia),
    )
    for joint in (*robot.joint_names, *robot.passive_names):
        for kind, words, sigma in of_joints:
            if sigma > 0 and modelled_value(robot, kind, joint) > 0:
                out.append(ToleranceParameter(f"{joint} {words}", sigma, 2 * sigma, kind, joint))
    # A recording from MuJoCo has soft friction; a real robot may have less of it or none.
    out += [
        ToleranceParameter(f"{joint} softness of friction", 1.0, 2.0, SOFTNESS, joint, relative=False)
        for joint in soft_joints(robot)
    ]
    # The arrival is uniform over a controller cycle: its standard deviation is 1 / sqrt(12) of the cycle.
    out += [
        ToleranceParameter(f"{joint} arrival of references", 0.29, 0.5, ARRIVAL, joint, relative=False)
        for joint in robot.unknown_arrivals
    ]
    if robot.floating:
        errors = SENSOR_ERRORS.items()
        out += [ToleranceParameter(name, sigma, 2 * sigma, BASE, name, relative=False) for name, sigma in errors]
    # Torque and motion are aligned except for an unknown fraction of a sample.
    out.append(ToleranceParameter("timing of the torque", 0.25, 0.5, TIMING, None, relative=False))
    return tuple(out)


def tolerance_columns(
    robot: Robot,
    operation: Operation,
    body: Float[Array, "nv n p"],
    log: Log,
    narrow: Callable[[Array], Array],
) -> list[list[Float[Array, " n"]]]:
    """For each joint, the columns in the band of the tolerance parameters that may change its torque.

    Args:
        robot: The given model.
        operation: One recording at the full rate.
        body: Columns of the rigid-body regressor in the band, by row.
        log: The recording, with the filter of all columns.
        narrow: Additional low pass for columns made of accelerations.
    """
    band = log.band
    per_sample_shift = narrow(band(np.gradient(operation.tau, axis=0)))
    parameters, changes = tolerance_parameters(robot), []
    of_base = torque_per_base_error(robot, log, operation) if log.base_sensors is not None else {}
    for parameter in parameters:
        if isinstance(parameter.owner, int):
            change = body[:, :, 10 * (parameter.owner - 1) : 10 * parameter.owner] @ parameter.direction
        elif parameter.owner is None:
            change = per_sample_shift.T
        elif parameter.kind == BASE:
            change = narrow(band(of_base[str(parameter.owner)])).T
        elif parameter.kind == SOFTNESS:
            change = band(softness(robot, operation, parameter.owner)).T
        elif parameter.kind == ARRIVAL:
            change = np.zeros_like(per_sample_shift.T)
            row = robot.joint_names.index(parameter.owner)
            if log.arrival is not None:
                change[row] = -band(log.arrival[:, row])
        else:
            # The column of the effect of this quantity, times the modelled value.
            kind, value = parameter.kind, modelled_value(robot, parameter.kind, parameter.owner)
            effect = effect_named("rotor_inertia" if kind == "rotor" else f"{kind}_friction")
            signature = effect.signature(robot, operation, parameter.owner, ())
            change = np.zeros_like(per_sample_shift.T)
            for k, row in enumerate(signature.rows):
                column = band(signature.columns[:, k, 0])
                change[row] = value * (narrow(column) if effect.uses_acceleration else column)
        changes.append(change)
    return [[changes[k][j] for k in acting] for j, acting in enumerate(parameters_by_joint(robot, parameters))]


def modelled_value(robot: Robot, kind: str, joint: str) -> float:
    """Modelled viscous friction, Coulomb friction or rotor inertia of a joint; zero for a rotor of a passive joint.

    Args:
        robot: The model.
        kind: ``viscous``, ``coulomb`` or ``rotor``.
        joint: The joint, which may be passive.
    """
    if kind == "rotor":
        return float(robot.rotor_inertia[robot.joint_names.index(joint)]) if joint in robot.joint_names else 0.0
    viscous, coulomb = modelled_friction_of(robot, joint)
    return viscous if kind == "viscous" else coulomb
