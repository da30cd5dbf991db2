# pyright: reportAttributeAccessIssue=false
"""The corrected model: a robot with the effects that a diagnosis found, in quantities that model files can state."""

from __future__ import annotations

import operator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pinocchio as pin

from identification.diagnosis.columns.terms import KnownEffect
from identification.excitation.limits import stated_torque_limits
from phantom_dyn.array_types import Array, Float
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.described import Coupling, ModelNumbers
from phantom_dyn.effects.support.changed_robot import with_friction, with_rotor_inertia
from phantom_dyn.effects.support.rows import driven_rows
from phantom_dyn.errors import ParameterError
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion


@dataclass(frozen=True)
class CorrectedModel:
    """A robot with its findings. Each mapping is by joint name, in SI units on the joint side.

    Attributes:
        given: The robot without the findings.
        base: The robot to which the findings were added: the given one, or the given one changed within its tolerances.
        robot: The robot with the findings on links, rotors, modelled friction and gravity.
        turned: Rotation from the given gravity to that of ``robot``, in the base frame.
        springs: Stiffness and relaxed position of each spring.
        offsets: Constant torques that act on the joints.
        gains: Ratios of true to logged torque.
        limits: Largest torque of each drive, found or stated by the configuration.
        delays: Delays of drives [s].
        lags: Time constants of drives [s].
        reference_delays: Delays of the references of position controllers [s].
        plays: Full widths of backlash.
        compliances: Stiffness of transmissions.
        cogging: Order [1/rad or 1/m], amplitude and phase [rad] of each wave.
        couplings: Couplings of two joints.
        zeros: Offsets of encoders, reading minus position.
        others: Effects that the other attributes express in part or not at all. Of a Stribeck law, for example, they
            contain only the friction at high speed.
    """

    given: Robot
    base: Robot
    robot: Robot
    turned: Float[Array, "3 3"]
    springs: dict[str, tuple[float, float]] = field(default_factory=dict)
    offsets: dict[str, float] = field(default_factory=dict)
    gains: dict[str, float] = field(default_factory=dict)
    limits: dict[str, float] = field(default_factory=dict)
    delays: dict[str, float] = field(default_factory=dict)
    lags: dict[str, float] = field(default_factory=dict)
    reference_delays: dict[str, float] = field(default_factory=dict)
    plays: dict[str, float] = field(default_factory=dict)
    compliances: dict[str, float] = field(default_factory=dict)
    cogging: dict[str, tuple[tuple[float, float, float], ...]] = field(default_factory=dict)
    couplings: tuple[Coupling, ...] = ()
    zeros: dict[str, float] = field(default_factory=dict)
    others: tuple[KnownEffect, ...] = ()


def corrected_model(robot: Robot, effects: tuple[KnownEffect, ...]) -> CorrectedModel:
    """The corrected model of a robot and its findings.

    Friction laws other than Coulomb and viscous friction are added to the robot in part: the mean of both directions,
    the level at high speed (Stribeck), or the level after the presliding displacement. The law itself is in ``others``.
    Torque limits of the robot's configuration are used if the torque columns are commands.

    Args:
        robot: The given model.
        effects: The findings, each with its parameters in the order of the catalogue.

    Raises:
        ParameterError: If an effect is unknown, has a wrong number of parameters, or one that is not finite.
        RobotError: If an effect is on a joint that the robot does not have, or takes more mass off a link than it has.
    """
    stated = {
        joint: float(actuator.torque_limit)
        for joint, actuator in zip(robot.joint_names, robot.actuators, strict=True)
        if actuator.torque_limit is not None and robot.torque_source == "command"
    }
    return with_effects(CorrectedModel(robot, robot, robot, np.eye(3), limits=stated), effects)


def torque_limits(corrected: CorrectedModel) -> dict[str, float]:
    """Largest torque by joint: the limit that was found, else that of the configuration or of the robot's file.

    `CorrectedModel.limits` lacks the limits of the robot's file, because edited copies of the file contain them.
    """
    stated = zip(corrected.given.joint_names, stated_torque_limits(corrected.given).tolist(), strict=True)
    return {joint: limit for joint, limit in stated if np.isfinite(limit)} | corrected.limits


def with_effects(corrected: CorrectedModel, effects: tuple[KnownEffect, ...]) -> CorrectedModel:
    """The corrected model with further findings; it raises the errors of `corrected_model`."""
    for effect in effects:
        for one in on_single_joints(corrected.given, effect):
            corrected = _with_effect(corrected, one)
    return corrected


def on_single_joints(robot: Robot, effect: KnownEffect) -> tuple[KnownEffect, ...]:
    """An effect with one number for several joints as one effect per joint; any other effect unchanged."""
    shared = effect_named(effect.effect, robot).shared and effect.joint not in robot.joint_names
    if not shared or effect.joint is None:
        return (effect,)
    return tuple(replace(effect, joint=joint) for joint in effect.joint.split("+"))


def numbers_of_effect(robot: Robot, effect: KnownEffect) -> ModelNumbers:
    """The numbers by which model files can express an effect; it raises the errors of `corrected_model`.

    Args:
        robot: The given model.
        effect: The effect, with its parameters in the order of the catalogue.
    """
    theta = _checked_parameters(robot, effect)
    return effect_named(effect.effect, robot).model_numbers(robot, effect.joint, theta)


def _with_effect(corrected: CorrectedModel, effect: KnownEffect) -> CorrectedModel:
    """The corrected model with one further effect on a single joint, on two joints or on the whole robot."""
    joint, numbers = effect.joint, numbers_of_effect(corrected.given, effect)
    corrected = replace(corrected, robot=_changed_robot(corrected.robot, joint, numbers))
    if numbers.turned is not None:
        corrected = replace(corrected, turned=numbers.turned @ corrected.turned)
    if numbers.coupling is not None:
        corrected = replace(corrected, couplings=(*corrected.couplings, numbers.coupling))
    times = {"delays": numbers.delay, "reference_delays": numbers.reference_delay, "lags": numbers.lag}
    for name, more in times.items():
        if more is not None:
            corrected = replace(corrected, **{name: _longer_times(corrected, getattr(corrected, name), joint, more)})
    corrected = _with_joint_numbers(corrected, str(joint), numbers)
    return corrected if numbers.whole else replace(corrected, others=(*corrected.others, effect))


def _changed_robot(robot: Robot, joint: str | None, numbers: ModelNumbers) -> Robot:
    """The robot with an effect's change of links, gravity, friction and rotors."""
    robot = robot if numbers.robot is None else numbers.robot(robot)
    if numbers.viscous or numbers.coulomb:
        robot = with_friction(robot, joint, viscous=numbers.viscous, coulomb=numbers.coulomb)
    return with_rotor_inertia(robot, joint, numbers.rotor_inertia) if numbers.rotor_inertia else robot


def _longer_times(
    corrected: CorrectedModel, times: dict[str, float], joint: str | None, more: float
) -> dict[str, float]:
    """Times of drives [s] by joint, increased by ``more`` on one joint; on all driven joints if ``joint`` is None."""
    joints = [corrected.robot.joint_names[row] for row in driven_rows(corrected.robot, joint)]
    return times | {name: times.get(name, 0.0) + more for name in joints}


def _with_joint_numbers(corrected: CorrectedModel, at: str, numbers: ModelNumbers) -> CorrectedModel:
    """The model with an effect's numbers of one joint, combined with the numbers that the model already has there."""
    ways = {
        "springs": (numbers.spring, _parallel_springs),
        "offsets": (numbers.offset, operator.add),
        "gains": (numbers.gain, operator.mul),
        "limits": (numbers.limit, min),
        "zeros": (numbers.zero, operator.add),
        "plays": (numbers.gap, operator.add),
        "compliances": (numbers.stiffness, lambda one, other: 1.0 / (1.0 / other + 1.0 / one)),
        "cogging": (numbers.waves or None, operator.add),
    }
    changed: dict[str, Any] = {}
    for name, (number, combine) in ways.items():
        known = getattr(corrected, name)
        if number is not None:
            changed[name] = known | {at: combine(known[at], number) if at in known else number}
    return replace(corrected, **changed)


def _parallel_springs(one: tuple[float, float], other: tuple[float, float]) -> tuple[float, float]:
    """Stiffness and relaxed position of two springs in parallel."""
    total = one[0] + other[0]
    return (total, (one[0] * one[1] + other[0] * other[1]) / total) if total else other


def _checked_parameters(robot: Robot, effect: KnownEffect) -> Float[Array, " p"]:
    """Parameters of an effect after a check of their number; missing ones at the end have their defaults."""
    law = effect_named(effect.effect, robot)
    known = law.parameters(robot, effect.joint)
    defaults = tuple(parameter.default for parameter in known[len(effect.theta) :])
    theta = np.array(effect.theta if None in defaults else (*effect.theta, *defaults), dtype=float)
    wanted, count = len(known), len(theta)
    lists = law.takes_lists(robot, effect.joint) and count > 0 and count % wanted == 0
    if not (lists or count in (wanted, wanted + len(law.optional_parameters(robot, effect.joint)))):
        raise ParameterError(
            f"{effect.effect} was given {count} parameters, wanted {wanted}: give those of the catalogue, in order."
        )
    if not np.isfinite(theta).all():
        raise ParameterError(f"{effect.effect} has a parameter that is not finite: give finite numbers.")
    return theta


def added_torque(corrected: CorrectedModel, motion: Motion) -> Float[Array, "N nv"]:
    """Torque [N m or N] that the drives need for springs, constant torques, cogging and couplings.

    Args:
        corrected: The corrected model.
        motion: N samples of the true motion of the active joints.
    """
    at = {joint: row for row, joint in enumerate(corrected.robot.joint_names)}
    out = np.zeros_like(motion.v)
    for joint, (stiffness, relaxed) in corrected.springs.items():
        out[:, at[joint]] += stiffness * (motion.q[:, at[joint]] - relaxed)
    for joint, offset in corrected.offsets.items():
        out[:, at[joint]] -= offset
    for joint, waves in corrected.cogging.items():
        orders, amplitudes, phases = np.array(waves).T
        out[:, at[joint]] -= np.sin(motion.q[:, at[joint], None] * orders + phases) @ amplitudes
    for c in corrected.couplings:
        first, second = at[c.first], at[c.second]
        speed, acceleration = (x[:, first] + c.ratio * x[:, second] for x in (motion.v, motion.a))
        shared = c.coulomb_torque * np.sign(speed) + c.coefficient * speed + c.inertia * acceleration
        out[:, first] += shared
        out[:, second] += c.ratio * shared
    return out


def with_zeros_moved(robot: Robot, zeros: dict[str, float]) -> Robot:
    """The robot whose joint positions are the readings of its encoders: ``reading = q + zero``.

    Args:
        robot: A robot without closed loops.
        zeros: Offsets of encoders by joint [rad or m].
    """
    if not zeros:
        return robot
    model = robot.model.copy()
    data = model.createData()
    q = np.zeros((1, robot.nv))
    for joint, zero in zeros.items():
        q[0, robot.joint_names.index(joint)] = -zero
    pin.forwardKinematics(model, data, robot.configuration(q)[0])
    for joint in zeros:
        index = model.getJointId(joint)
        model.jointPlacements[index] = data.liMi[index]
        if model.joints[index].nq == 1:
            at = model.joints[index].idx_q
            for limits in (model.lowerPositionLimit, model.upperPositionLimit):
                limits[at] += zeros[joint]
    return replace(robot, model=model)


def with_base_turned(robot: Robot, rotation: Float[Array, "3 3"]) -> Robot:
    """The robot with its base rotated in the world, in which gravity is unchanged."""
    model = robot.model.copy()
    turn = pin.SE3(np.array(rotation), np.zeros(3))
    for index in range(1, model.njoints):
        if model.parents[index] == 0:
            model.jointPlacements[index] = turn * model.jointPlacements[index]
    for frame in model.frames:
        if frame.parentJoint == 0 and frame.name != "universe":
            frame.placement = turn * frame.placement
    return replace(robot, model=model)
