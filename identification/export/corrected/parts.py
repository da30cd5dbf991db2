# pyright: reportAttributeAccessIssue=false
"""A robot with findings, sorted by the places that files and control laws have for them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from identification.diagnosis.model.terms import KnownEffect
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.support.changed_robot import with_friction
from phantom_dyn.effects.support.rows import driven_rows
from phantom_dyn.errors import ParameterError
from phantom_dyn.model.robot import Robot

Array = np.ndarray

_OF_THE_ROBOT = ("viscous_friction", "coulomb_friction", "rotor_inertia", "payload", "inertial_parameters", "base_tilt")
"""Effects whose simulation is another robot and nothing else."""


@dataclass(frozen=True)
class Coupling:
    """Something that turns with ``v_first + ratio v_second``, see `phantom_dyn.effects.friction.joint_coupling`."""

    first: str
    second: str
    ratio: float
    coulomb_torque: float
    coefficient: float
    inertia: float


@dataclass(frozen=True)
class Parts:
    """A robot and what was found of it; mappings are from joint to value, SI units on the joint side.

    Attributes:
        given: The robot without the findings.
        base: The same, or with the moves within its tolerances: what the findings were added to.
        robot: With other links, rotors, modelled friction and gravity.
        turned: Rotation that takes the given gravity, in the base frame, to the robot's.
        springs: Stiffness and rest position.
        offsets: Constant torques.
        gains: True torque over logged torque.
        limits: Torque beyond which a drive gives no more.
        delays, lags: Times [s] by which drives are late, and time constants.
        plays: Full width of plays.
        compliances: Stiffness of transmissions.
        cogging: Order, amplitude and phase of each wave.
        couplings: Between two joints.
        zeros: How much encoders read too much.
        others: Effects that are in none of these, or only in part: direction dependence, the fall of a Stribeck law.
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
    plays: dict[str, float] = field(default_factory=dict)
    compliances: dict[str, float] = field(default_factory=dict)
    cogging: dict[str, tuple[tuple[float, float, float], ...]] = field(default_factory=dict)
    couplings: tuple[Coupling, ...] = ()
    zeros: dict[str, float] = field(default_factory=dict)
    others: tuple[KnownEffect, ...] = ()


def parts_of(robot: Robot, effects: tuple[KnownEffect, ...]) -> Parts:
    """A robot and its findings, sorted.

    Of friction laws that are more than Coulomb and viscous friction, the robot gets the mean of both directions, the
    level at high speed (Stribeck) and the level behind the bristle (presliding); the law itself is under ``others``.
    Torque limits that the robot's configuration states count where the torque columns are commands.

    Args:
        robot: The given model.
        effects: What was found, with the contract's parameters in order.

    Raises:
        ParameterError: If an effect is unknown, has not as many parameters as its law takes, or one is not finite.
        RobotError: If an effect is on a joint that the robot does not have, or takes more mass off a link than it has.
    """
    stated = {
        joint: float(actuator.torque_limit)
        for joint, actuator in zip(robot.joint_names, robot.actuators, strict=True)
        if actuator.torque_limit is not None and robot.torque_source == "command"
    }
    out = Parts(robot, robot, robot, np.eye(3), limits=stated)
    for effect in effects:
        out = _with(out, effect)
    return out


def _with(parts: Parts, effect: KnownEffect) -> Parts:
    name, joint = effect.effect, effect.joint
    theta = _checked(parts.given, effect)
    robot = parts.robot
    if name in _OF_THE_ROBOT:
        change = effect_named(name).simulated(parts.given, joint, theta).robot
        turned = _turn(*theta) @ parts.turned if name == "base_tilt" else parts.turned
        return replace(parts, robot=robot if change is None else change(robot), turned=turned)
    if name == "joint_coupling":
        first, _, second = (joint or "").partition("+")
        return replace(parts, couplings=(*parts.couplings, Coupling(first, second, *theta.tolist())))
    if name in ("input_delay", "actuator_lag"):
        times = dict(parts.delays if name == "input_delay" else parts.lags)
        for row in driven_rows(robot, joint):
            times[robot.joint_names[row]] = times.get(robot.joint_names[row], 0.0) + float(theta[0])
        return replace(parts, delays=times) if name == "input_delay" else replace(parts, lags=times)
    at = str(joint)
    value = float(theta[0])
    if name == "parasitic_spring":
        return replace(parts, springs={**parts.springs, at: _springs(parts.springs.get(at), value, float(theta[1]))})
    if name == "torque_offset":
        return replace(parts, offsets={**parts.offsets, at: parts.offsets.get(at, 0.0) + value})
    if name == "torque_constant":
        return replace(parts, gains={**parts.gains, at: parts.gains.get(at, 1.0) * value})
    if name == "torque_saturation":
        return replace(parts, limits={**parts.limits, at: min(parts.limits.get(at, np.inf), value)})
    if name == "encoder_offset":
        return replace(parts, zeros={**parts.zeros, at: parts.zeros.get(at, 0.0) + value})
    if name == "backlash":
        return replace(parts, plays={**parts.plays, at: parts.plays.get(at, 0.0) + value})
    if name == "transmission_compliance":
        softer = 1.0 / (1.0 / value + 1.0 / parts.compliances.get(at, np.inf))
        return replace(parts, compliances={**parts.compliances, at: softer})
    if name == "cogging":
        waves = tuple((float(n), float(a), float(p)) for n, a, p in np.reshape(theta, (3, -1)).T)
        return replace(parts, cogging={**parts.cogging, at: (*parts.cogging.get(at, ()), *waves)})
    return _simplified(parts, effect, theta)


def _simplified(parts: Parts, effect: KnownEffect, theta: Float[Array, " p"]) -> Parts:
    """Laws that are friction of another kind, with what of them is Coulomb friction, viscous friction and offset."""
    robot, joint = parts.robot, effect.joint
    offsets = dict(parts.offsets)
    if effect.effect == "direction_dependent_friction":
        robot = with_friction(robot, joint, coulomb=0.5 * (theta[0] + theta[1]), viscous=0.5 * (theta[2] + theta[3]))
        offsets[str(joint)] = offsets.get(str(joint), 0.0) - 0.5 * float(theta[0] - theta[1])
    elif effect.effect in ("stribeck_friction", "presliding_friction"):
        robot = with_friction(robot, joint, coulomb=float(theta[0]))
    return replace(parts, robot=robot, offsets=offsets, others=(*parts.others, effect))


def _springs(one: tuple[float, float] | None, stiffness: float, rest: float) -> tuple[float, float]:
    """Two springs side by side as one."""
    if one is None or one[0] + stiffness == 0:
        return stiffness, rest
    whole = one[0] + stiffness
    return whole, (one[0] * one[1] + stiffness * rest) / whole


def _checked(robot: Robot, effect: KnownEffect) -> Float[Array, " p"]:
    law = effect_named(effect.effect)
    theta = np.asarray(effect.theta, dtype=float)
    wanted = len(law.parameters(robot, effect.joint))
    count = len(theta)
    fits = count == wanted or (effect.effect == "cogging" and count > 0 and count % 3 == 0)
    if not (fits or (effect.effect == "presliding_friction" and count == 4)):
        raise ParameterError(
            f"{effect.effect} was given {count} parameters, wanted {wanted}: give the contract's, in order."
        )
    if not np.isfinite(theta).all():
        raise ParameterError(f"{effect.effect} has a parameter that is not finite: give finite numbers.")
    return theta


def _turn(roll: float, pitch: float) -> Float[Array, "3 3"]:
    """``R_x(roll) R_y(pitch)``."""
    return pin.utils.rotate("x", float(roll)) @ pin.utils.rotate("y", float(pitch))


def with_zeros_moved(robot: Robot, zeros: dict[str, float]) -> Robot:
    """The robot with joints whose positions are what their encoders read: ``reading = q + zero``.

    Args:
        robot: A robot without closed loops.
        zeros: By joint [rad or m].
    """
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
    """The robot on a base that stands turned in the world; gravity stays what it is."""
    model = robot.model.copy()
    turn = pin.SE3(np.array(rotation), np.zeros(3))
    for index in range(1, model.njoints):
        if model.parents[index] == 0:
            model.jointPlacements[index] = turn * model.jointPlacements[index]
    for frame in model.frames:
        if frame.parentJoint == 0 and frame.name != "universe":
            frame.placement = turn * frame.placement
    return replace(robot, model=model)
