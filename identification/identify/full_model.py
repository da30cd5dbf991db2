# pyright: reportAttributeAccessIssue=false
"""The given robot with what was identified: possible inertias nearest to the given ones, friction, rotors."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from identification.estimators.fit import Fit
from identification.estimators.full_parameters import full_parameters
from phantom_dyn.dynamics import inverse_dynamics, standard_parameters
from phantom_dyn.errors import EstimationError, ParameterError
from phantom_dyn.motion import Motion
from phantom_dyn.robot import Robot

Array = np.ndarray

# A body moves if its parameters differ by more than this share of the largest of their kind: less is rounding.
_SAME = 1e-12


@dataclass(frozen=True)
class FullModel:
    """The identified model as a robot.

    Attributes:
        robot: With the identified inertias, friction and rotors.
        offset: Constant torque on each joint, positive along it [N m or N], shape ``(nv,)``: no part of the robot.
        asymmetry: Joints whose friction differs by direction; the robot has the mean of both.
        words: How the inertias were chosen, or why they are the given ones.
        possible: False if no possible inertias were found, so that the robot has the given ones.
        moved: Largest move of a base parameter, in standard deviations, that makes bodies possible.
    """

    robot: Robot
    offset: Float[Array, " nv"]
    asymmetry: tuple[str, ...]
    words: str
    possible: bool
    moved: float


def full_model(given: Robot, fitted: Robot, fit: Fit) -> FullModel:
    """The given robot with everything that a fit says of it.

    Args:
        given: As its file states it: the reference of the inertias.
        fitted: The robot that was fitted, without what was an unknown.
        fit: Of rigid body and effects.
    """
    model = fitted.model.copy()
    try:
        full = full_parameters(fitted, fit)
    except (ParameterError, EstimationError) as error:
        values = dict(zip((fit.base.names[k] for k in fit.base.independent), fit.theta.tolist(), strict=True))
        words, possible, moved = f"The inertias are those of the given model: {error}", False, float("nan")
    else:
        values = dict(zip(full.names, full.pi.tolist(), strict=True))
        moved = float(np.max(np.abs(full.moved), initial=0.0))
        possible = True
        words = (
            "Of all physically possible bodies with the identified base parameters these are nearest to the given ones."
            if moved < 0.01
            else "No possible bodies have exactly the identified base parameters: these are the nearest, with base "
            f"parameters moved by up to {moved:.2g} standard deviations."
        )
        _set_inertias(model, given, full.pi[: fit.first_effect])
    robot = replace(fitted, model=model)
    offset, asymmetry = np.zeros(robot.nv), []
    viscous, coulomb = np.array(robot.viscous_friction), np.array(robot.coulomb_friction)
    armature = np.array(model.armature)
    for term in fit.effects:
        if term.joint not in robot.joint_names:
            continue
        j = robot.joint_names.index(term.joint)

        def of(name: str, label: str = term.label) -> float:
            return values.get(f"{label}.{name}", 0.0)

        if term.effect.name == "viscous_friction":
            viscous[j] += of("coefficient")
        elif term.effect.name == "coulomb_friction":
            coulomb[j] += of("torque")
        elif term.effect.name == "torque_offset":
            offset[j] += of("torque")
        elif term.effect.name == "rotor_inertia":
            armature[robot.tree_rows[j]] += of("inertia")
        elif term.effect.name == "direction_dependent_friction":
            viscous[j] += 0.5 * (of("coefficient_positive") + of("coefficient_negative"))
            coulomb[j] += 0.5 * (of("torque_positive") + of("torque_negative"))
            offset[j] -= 0.5 * (of("torque_positive") - of("torque_negative"))
            asymmetry.append(term.joint)
    model.armature = armature
    robot = replace(robot, model=model, viscous_friction=viscous, coulomb_friction=coulomb)
    return FullModel(robot, offset, tuple(asymmetry), words, possible, moved)


def model_torque(full: FullModel, motion: Motion) -> Float[Array, "N nv"]:
    """Drive torque that the full model needs for a motion, offsets included, shape ``(N, nv)`` [N m or N]."""
    return inverse_dynamics(full.robot, motion) - full.offset


def _set_inertias(model: pin.Model, given: Robot, pi: Float[Array, " p"]) -> None:
    before = standard_parameters(given).reshape(-1, 10)
    after = pi.reshape(-1, 10)
    scale = np.maximum(np.abs(before).max(axis=0), np.abs(after).max(axis=0))
    for j, (old, new) in enumerate(zip(before, after, strict=True), start=1):
        if (np.abs(new - old) > _SAME * scale).any():
            model.inertias[j] = pin.Inertia.FromDynamicParameters(new)
