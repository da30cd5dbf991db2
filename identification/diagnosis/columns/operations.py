"""Motion and modelled torque of each recording, from which effects compute their columns.

The torque of some effects depends on the model: a late drive delays the torque that the robot needs, and a tilted base
changes the direction of gravity on its masses. Errors of the model would make the sizes of these effects wrong. So the
torque can also be computed from the model adjusted within its tolerances.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from identification.data.log import Log
from identification.diagnosis.columns.motion.standstill import standing_still
from identification.diagnosis.columns.terms import FoundEffect, KnownEffect
from identification.diagnosis.columns.tolerance_parameters import OF_THE_RECORDING, modelled_value, tolerance_parameters
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

# Parameters decrease by at most this share, whatever tolerance a file states.
_LEAST = -0.9
# Step of the load for the derivative of a law, as a share of the load.
_LOAD_STEP = 1e-4


def operate(
    robot: Robot, log: Log, known: tuple[KnownEffect, ...], recording: int = 0, band_hz: float = np.inf
) -> Operation:
    """Motion of a log with the torque of the given model.

    Args:
        robot: The given model.
        log: Motion and measured torque.
        known: Effects that belong to the model already.
        recording: Index of the log among several.
        band_hz: Edge of the judged band [Hz].
    """
    motion = motion_of(log)
    tau = inverse_dynamics(robot, motion)
    # The drive need not give the torque of a known external force.
    tau = tau if log.external is None else tau - log.external
    state = (motion.t, motion.q, motion.v, motion.a)
    more = {"temperature": log.temperature, "references": log.references, "base": motion.base}
    plain = Operation(*state, robot, tau, tau, log.tau, None, recording, band_hz, **more)
    return with_known(robot, plain, known) if known else plain


def motion_of(log: Log) -> Motion:
    """Motion of a log, with zero velocity and acceleration for joints that stand still all the time.

    Otherwise the modelled friction of such a joint would follow the sign of noise, and its noisy acceleration would
    change the modelled torques of other joints.
    """
    moves = ~standing_still(log).all(axis=0)
    return log.motion.with_joints(log.motion.q, log.motion.v * moves, log.motion.a * moves)


def carrying_known(robot: Robot, known: Iterable[KnownEffect]) -> Robot:
    """The robot whose last link carries the payloads of earlier diagnoses; a new payload may then be negative.

    Args:
        robot: The given model.
        known: Effects that belong to the model already.
    """
    return carrying(robot, [np.array(one.theta) for one in known if one.effect == "payload"])


def with_known(robot: Robot, operation: Operation, known: tuple[KnownEffect, ...]) -> Operation:
    """The operation with the torque of known effects added to that of the given model.

    Each effect is computed from the torque on which it acts, as in the fit that found it: friction under load from the
    transmitted torque, a late drive from the commanded torque, a torque constant from all of these torques. A mass acts
    at the true positions of the links, and in the true gravity.

    Args:
        robot: The given model.
        operation: Motion and torque of the given model alone.
        known: The effects.
    """
    effects = [(effect_named(one.effect, robot), one) for one in known]
    # Robot in the true gravity, and true motion of its links.
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
        staged = replace(operation, tau=tau if stage == 3 else operation.tau, expected=tau, found_load=found_load)
        for effect, one in effects:
            if _stage_of(effect) == stage:
                # The drive gives the torque that the model needs, minus the torque of the effect.
                if effect.inertial is not None and displacing:
                    truly = replace(staged, robot=true_robot, q=motion.q, v=motion.v, a=motion.a)
                    torque = effect.torque(true_robot, truly, one.joint, np.array(one.theta))
                else:
                    torque = effect.torque(robot, staged, one.joint, np.array(one.theta))
                tau = tau - torque
                if effect.on_link:
                    found_load = found_load - torque
                else:
                    in_drive = in_drive - torque
    per_load = _per_load(robot, operation, found_load, effects)
    return replace(operation, tau=tau, expected=tau, found_load=None, per_load=per_load, known_in_drive=in_drive)


def _per_load(
    robot: Robot,
    operation: Operation,
    found_load: Float[Array, "N nv"],
    effects: list[tuple[Effect, KnownEffect]],
) -> Float[Array, "N nv"] | None:
    """Derivative of the drive torque with respect to the torque on the link; None without effects that depend on load.

    If a later fit finds another load, the torque of known effects that depend on load changes by this derivative times
    the change of load. At a load of zero, where laws have a kink, the derivative of the law is taken as zero.

    Args:
        robot: The given model.
        operation: Motion and torque of the given model alone.
        found_load: Torque of the known effects on the links.
        effects: Known effects.
    """
    following = [(effect, one) for effect, one in effects if effect.follows_load and not effect.on_link]
    if not following:
        return None
    load = replace(operation, found_load=found_load).load
    step = _LOAD_STEP * np.sqrt(np.mean(load**2, axis=0)) + 1e-12
    out = np.ones_like(load)
    above, below = (replace(operation, found_load=found_load + side * step) for side in (1.0, -1.0))
    for effect, one in following:
        more, less = (effect.torque(robot, at, one.joint, np.array(one.theta)) for at in (above, below))
        out -= (more - less) / (2.0 * step)
    return out


def _stage_of(effect: Rival) -> int:
    """Stage, 0 to 3, in which the torque of an effect is computed: after all torques on which the effect depends."""
    return 3 if effect.scales_joint else 2 if effect.follows_torque else 1 if effect.follows_load else 0


def expecting(operation: Operation, found: tuple[FoundEffect, ...]) -> Operation:
    """The operation with the expected torque: that of the given model and of the effects of the last fit."""
    plain = operation.after_fit(operation.tau)
    found_load = np.zeros_like(operation.tau)
    for point in found:
        if point.effect.on_link:
            found_load += _torque_of(plain, point)
    plain, expected = plain.after_fit(operation.tau, found_load=found_load), operation.tau
    for point in found:
        if not (point.effect.follows_torque or point.effect.scales_joint):
            expected = expected + _torque_of(plain, point)
    return plain.after_fit(expected)


def _torque_of(operation: Operation, point: FoundEffect) -> Float[Array, "N nv"]:
    """Drive torque of an effect of the last fit."""
    signature = point.effect.signature(operation.robot, operation, point.joint, point.shape)
    out = np.zeros_like(operation.tau)
    out[:, list(signature.rows)] = signature.columns @ point.coefficients
    return out


def where_links_are(robot: Robot, motion: Motion, found: tuple[FoundEffect, ...]) -> tuple[Robot, Motion]:
    """The robot with the true direction of gravity, and the true motion of its links, according to the last fit.

    Args:
        robot: The given model.
        motion: Recorded motion.
        found: Effects that displace links or turn gravity.
    """
    for point in found:
        assert isinstance(point.effect, Effect)
        theta = point.effect.from_coefficients(robot, point.joint, point.coefficients, point.shape)
        robot, motion = point.effect.true_motion(robot, motion, point.joint, theta)
    return robot, motion


def friction_with(operation: Operation, found: tuple[FoundEffect, ...]) -> Float[Array, "N nv"]:
    """Friction torque of the model and of the last fit's friction effects, as part of the drive torque."""
    return sum((_torque_of(operation, point) for point in found if point.effect.rubs), operation.own_friction)


def adjusted_robot(robot: Robot, changes: Float[Array, " n"], given: Robot | None = None) -> Robot:
    """The given model after changes within its tolerances.

    Args:
        robot: The given model, or the given model with a known load.
        changes: Change of each of the `tolerance_parameters`.
        given: The given model, if ``robot`` carries a load; None: ``robot`` is the given model.
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
        elif owner is not None and parameter.kind not in OF_THE_RECORDING:
            out = with_friction(out, owner, **{parameter.kind: value * modelled_value(robot, parameter.kind, owner)})
    return with_parameters(out, change)


def moved_operation(operation: Operation, robot: Robot) -> Operation:
    """The operation with the torque of another model in place of the given one.

    Args:
        operation: Motion and torque of the given model.
        robot: The other model.
    """
    more = inverse_dynamics(robot, operation) - inverse_dynamics(operation.robot, operation)
    return replace(operation, robot=robot, tau=operation.tau + more, expected=operation.expected + more)
