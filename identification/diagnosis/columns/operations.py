"""Motion and modelled torque of each recording (`Operation`), from which effects compute their columns.

The torque of some effects depends on the torque of the model: a late drive delays the torque that the robot needs, and
a tilted base changes the direction of gravity on the masses. So errors of the model would change the found sizes of
these effects. To avoid this, operations can also be computed from the model adjusted within its tolerances.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from identification.data.log import Log
from identification.diagnosis.columns.motion.standstill import standing_still
from identification.diagnosis.columns.terms import FoundEffect, KnownEffect
from identification.diagnosis.columns.tolerance_parameters import RECORDING_KINDS, modelled_value, tolerance_parameters
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.dynamics import inverse_dynamics, standard_parameters
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.effect import Effect
from phantom_dyn.effects.load.payload import carrying
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.rival import Rival
from phantom_dyn.effects.support.changed_robot import with_friction, with_parameters, with_rotor_inertia
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion

# Smallest relative change of a parameter, however large its stated tolerance is: so masses stay above zero.
_LEAST = -0.9
# Step of the load for the numerical derivative of a law, as a share of the root mean square of the load.
_LOAD_STEP = 1e-4


def operation_of(
    robot: Robot, log: Log, known: tuple[KnownEffect, ...], recording: int = 0, band_hz: float = np.inf
) -> Operation:
    """Motion of a log with the torque of the given model.

    Args:
        robot: The given model.
        log: Motion and measured torque.
        known: Effects that are already in the model.
        recording: Index of the log among several.
        band_hz: Cutoff of the judged band [Hz].
    """
    motion = motion_of(log)
    tau = inverse_dynamics(robot, motion)
    # A known external force gives a part of the needed torque, so that the drive need not give it.
    tau = tau if log.external is None else tau - log.external
    state = (motion.t, motion.q, motion.v, motion.a)
    more = {"temperature": log.temperature, "references": log.references, "base": motion.base}
    plain = Operation(*state, robot, tau, tau, log.tau, None, recording, band_hz, **more)
    return with_known(robot, plain, known) if known else plain


def motion_of(log: Log) -> Motion:
    """Motion of a log, in which joints that stand still all the time have zero velocity and acceleration.

    Otherwise the modelled friction of such a joint would follow the sign of noise in its velocity, and noise in its
    acceleration would change the modelled torques of other joints.
    """
    moves = ~standing_still(log).all(axis=0)
    return log.motion.with_joints(log.motion.q, log.motion.v * moves, log.motion.a * moves)


def with_known_payloads(robot: Robot, known: Iterable[KnownEffect]) -> Robot:
    """The robot with the payloads of earlier diagnoses on its last link, which a new negative payload may remove.

    Args:
        robot: The given model.
        known: Effects that are already in the model.
    """
    return carrying(robot, [np.array(one.theta) for one in known if one.effect == "payload"])


def with_known(robot: Robot, operation: Operation, known: tuple[KnownEffect, ...]) -> Operation:
    """The operation with the torque of known effects added to that of the given model.

    Each effect is computed from the torque on which it acts, as in the fit that found it: friction under load from the
    transmitted torque, a late drive from the commanded torque, and a torque constant from all torques together. Masses
    are computed at the true positions of the links, and with the true gravity.

    Args:
        robot: The given model.
        operation: Motion and torque of the given model alone.
        known: Effects of earlier diagnoses.
    """
    effects = [(effect_named(one.effect, robot), one) for one in known]
    # Robot with the true direction of gravity, and true motion of its links.
    true_robot, motion = robot, operation.at(slice(None))
    for effect, one in effects:
        true_robot, motion = effect.true_motion(true_robot, motion, one.joint, np.array(one.theta))
    tau, found_load, in_drive = operation.tau, np.zeros_like(operation.tau), np.zeros_like(operation.tau)
    displacing = [pair for pair in effects if pair[0].displaces]
    if len(displacing) > 1:
        # The torque of several displacements together is not the sum of their single torques.
        tau = tau + inverse_dynamics(true_robot, motion) - inverse_dynamics(robot, operation)
        effects = [pair for pair in effects if not pair[0].displaces]
    for stage in range(4):
        # Effects of one stage do not depend on each other, so they are computed from the same torques.
        staged = replace(operation, tau=tau if stage == 3 else operation.tau, expected=tau, found_load=found_load)
        truly_moving = replace(staged, robot=true_robot, q=motion.q, v=motion.v, a=motion.a)
        for effect, one in effects:
            if _stage_of(effect) != stage:
                continue
            at_true_positions = effect.inertial is not None and bool(displacing)
            on_robot, at = (true_robot, truly_moving) if at_true_positions else (robot, staged)
            torque = effect.torque(on_robot, at, one.joint, np.array(one.theta))
            # The drive gives the torque that the model needs, minus the torque of the effect.
            tau = tau - torque
            if effect.on_link:
                found_load = found_load - torque
            else:
                in_drive = in_drive - torque
    per_load = _torque_per_load(robot, operation, found_load, effects)
    return replace(operation, tau=tau, expected=tau, found_load=None, per_load=per_load, known_in_drive=in_drive)


def _torque_per_load(
    robot: Robot,
    operation: Operation,
    found_load: Float[Array, "N nv"],
    effects: list[tuple[Effect, KnownEffect]],
) -> Float[Array, "N nv"] | None:
    """Derivative of the drive torque with respect to the load on the link; None without effects that depend on load.

    If a later fit finds another load, the torque of the drive changes by this derivative times the change of load. It
    is one without known effects. At a load of zero, where laws have a kink, the central difference gives a slope of
    zero for the law.

    Args:
        robot: The given model.
        operation: Motion and torque of the given model alone.
        found_load: Torque of the known effects on the links.
        effects: Known effects.
    """
    depending = [(effect, one) for effect, one in effects if effect.follows_load and not effect.on_link]
    if not depending:
        return None
    load = replace(operation, found_load=found_load).load
    step = _LOAD_STEP * np.sqrt(np.mean(load**2, axis=0)) + 1e-12
    out = np.ones_like(load)
    above, below = replace(operation, found_load=found_load + step), replace(operation, found_load=found_load - step)
    for effect, one in depending:
        theta = np.array(one.theta)
        change = effect.torque(robot, above, one.joint, theta) - effect.torque(robot, below, one.joint, theta)
        out -= change / (2.0 * step)
    return out


def _stage_of(effect: Rival) -> int:
    """Stage, 0 to 3, in which the torque of an effect is computed: after all torques on which the effect depends."""
    if effect.scales_joint:
        return 3
    if effect.follows_torque:
        return 2
    return 1 if effect.follows_load else 0


def with_expected_torque(operation: Operation, found: tuple[FoundEffect, ...]) -> Operation:
    """The operation whose expected torque is that of the given model plus that of the effects of the last fit.

    Effects that are computed from the expected torque (late drives, torque constants) are not included.
    """
    without_fit = operation.after_fit(operation.tau)
    found_load = np.zeros_like(operation.tau)
    for one in found:
        if one.effect.on_link:
            found_load += _torque_of(without_fit, one)
    with_load, expected = without_fit.after_fit(operation.tau, found_load=found_load), operation.tau
    for one in found:
        if not (one.effect.follows_torque or one.effect.scales_joint):
            expected = expected + _torque_of(with_load, one)
    return with_load.after_fit(expected)


def _torque_of(operation: Operation, found: FoundEffect) -> Float[Array, "N nv"]:
    """Additional drive torque by an effect of the last fit."""
    signature = found.effect.signature(operation.robot, operation, found.joint, found.shape)
    out = np.zeros_like(operation.tau)
    out[:, list(signature.rows)] = signature.columns @ found.coefficients
    return out


def true_robot_and_motion(robot: Robot, motion: Motion, found: tuple[FoundEffect, ...]) -> tuple[Robot, Motion]:
    """The robot with the true direction of gravity, and the true motion of its links, according to the last fit.

    Args:
        robot: The given model.
        motion: Recorded motion.
        found: Effects that displace links or turn gravity.
    """
    for one in found:
        assert isinstance(one.effect, Effect)
        theta = one.effect.from_coefficients(robot, one.joint, one.coefficients, one.shape)
        robot, motion = one.effect.true_motion(robot, motion, one.joint, theta)
    return robot, motion


def friction_torque_with(operation: Operation, found: tuple[FoundEffect, ...]) -> Float[Array, "N nv"]:
    """Part of the drive torque that overcomes friction, by the model and by effects of friction in the last fit."""
    return sum((_torque_of(operation, one) for one in found if one.effect.rubs), operation.own_friction)


def adjusted_robot(robot: Robot, changes: Float[Array, " n"], given: Robot | None = None) -> Robot:
    """The given model after changes within its tolerances.

    Args:
        robot: The given model, or the given model with a known load.
        changes: Change of each of the `tolerance_parameters`, ``(n,)``.
        given: The given model without a load, which states the tolerances; None: ``robot`` is the given model.
    """
    change = np.zeros_like(standard_parameters(robot))
    out = robot
    parameters = tolerance_parameters(robot if given is None else given)
    for parameter, value in zip(parameters, np.maximum(changes, _LEAST), strict=True):
        owner = parameter.owner
        if isinstance(owner, int):
            if parameter.direction is not None:
                change[10 * (owner - 1) : 10 * owner] += value * parameter.direction
        elif owner is not None and parameter.kind == "rotor":
            out = with_rotor_inertia(out, owner, value * modelled_value(robot, "rotor", owner))
        elif owner is not None and parameter.kind not in RECORDING_KINDS:
            out = with_friction(out, owner, **{parameter.kind: value * modelled_value(robot, parameter.kind, owner)})
    return with_parameters(out, change)


def operation_of_model(operation: Operation, robot: Robot) -> Operation:
    """The operation with the torque of another model in place of the given one.

    Args:
        operation: Motion and torque of the given model.
        robot: The other model.
    """
    difference = inverse_dynamics(robot, operation) - inverse_dynamics(operation.robot, operation)
    return replace(operation, robot=robot, tau=operation.tau + difference, expected=operation.expected + difference)
