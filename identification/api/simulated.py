"""Converts the arguments of `phantom_dyn.simulate`: reference, controller gains and effects."""

from __future__ import annotations

from pathlib import Path
from typing import cast

import numpy as np

from identification.api.diagnosis import Diagnosis
from identification.api.inputs import as_tuple, described
from identification.api.results import Reference
from identification.data.readers.read_table import read_raw
from identification.degrade.degraded_log import degradation
from identification.diagnosis.columns.known_geometry import POSE_EFFECTS
from identification.diagnosis.columns.terms import KnownEffect
from identification.export.corrected.corrected_yaml import known_effects
from identification.export.corrected.found_effects import effect_of, findings_in_all_recordings
from phantom_dyn.arguments import NUMBERS
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.dynamics import inverse_dynamics, mass_matrix
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.effect import Effect
from phantom_dyn.effects.user.user_effects import with_user_effects
from phantom_dyn.errors import LogError, ParameterError, UsageError
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion
from phantom_dyn.simulation.control import Tracking
from phantom_dyn.simulation.simulate import Cause

_BANDWIDTH = 2 * np.pi * 5.0
"""Bandwidth of the default position controller [rad/s]: well above the frequencies of an exciting motion."""


def reference_of(robot: Robot, given: object) -> Motion:
    """The reference motion of a simulated robot.

    Raises:
        UsageError: If ``given`` is no motion.
        LogError: If a file has no reference for a joint.
    """
    if isinstance(given, Reference):
        if given.robot.joint_names != robot.joint_names:
            raise UsageError(
                f"the reference is of {given.robot.name} and the robot is {robot.name}: design one for this robot."
            )
        given = given.motion
    if isinstance(given, str | Path):
        given = _read_reference(robot, given)
    if not isinstance(given, Motion):
        raise UsageError(
            f"{described(given)} was given as the reference, wanted what excite returned, a motion, or a table with t "
            "and q_ref.<joint>."
        )
    if given.q.shape[1:] != (robot.nv,) or len(given.t) < 2:
        raise UsageError(
            f"the reference has positions of shape {given.q.shape}, wanted at least two rows of {robot.nv} joints."
        )
    return given


def _read_reference(robot: Robot, path: str | Path) -> Motion:
    """The reference in a file with the columns ``t`` and ``q_ref.<joint>``."""
    raw = read_raw(path)
    names = ["t", *(f"q_ref.{joint}" for joint in robot.joint_names)]
    lacking = [name for name in names if name not in raw.columns]
    if lacking:
        raise LogError(f"{raw.file} has no column {lacking[0]}, wanted {', '.join(names)}: excite writes such a table.")
    t, q = raw.columns["t"], np.column_stack([raw.columns[name] for name in names[1:]])
    if len(t) < 3 or not (np.diff(t) > 0).all() or not np.isfinite(q).all():
        raise LogError(f"{raw.file} is no reference: wanted three rows or more of finite numbers, time increasing.")
    v = np.gradient(q, t, axis=0)
    return Motion(t, q, v, np.gradient(v, t, axis=0))


def with_named_effects(robot: Robot, given: object) -> Robot:
    """The robot with a catalogue that also contains the given effects of the user's own.

    Args:
        robot: The robot.
        given: A diagnosis, or effects as in `causes_of`.

    Raises:
        EffectError: If an effect cannot be used.
    """
    if isinstance(given, Diagnosis):
        given_effects = () if given.robot is None else cast("tuple[Effect, ...]", given.robot.user_effects)
    else:
        firsts = [one[0] for one in as_tuple(given) if isinstance(one, tuple | list) and one]
        given_effects = tuple(one for one in firsts if isinstance(one, Effect | type))
    known = {effect.name for effect in robot.user_effects}
    new = {getattr(one, "name", ""): one for one in given_effects if getattr(one, "name", "") not in known}
    return with_user_effects(robot, tuple(new.values()))


def causes_of(robot: Robot, given: object) -> tuple[Cause, ...]:
    """The effects that a simulated robot has in addition to its model.

    Args:
        robot: The robot.
        given: A diagnosis, the path of a ``corrected.yaml``, or tuples of effect, joint and parameters.

    Raises:
        UsageError: If ``given`` is anything else.
        ParameterError: If an effect, joint or parameter is unknown or impossible; the message lists the known ones.
    """
    if isinstance(given, Diagnosis):
        return tuple(_cause(robot, effect_of(robot, finding)) for finding in findings_in_all_recordings(given.result))
    if isinstance(given, str | Path):
        return tuple(_cause(robot, known) for known in known_effects((Path(given),), robot))
    return tuple(_cause_of_tuple(robot, one) for one in as_tuple(given))


def tracking(robot: Robot, motion: Motion, kp: object, kd: object) -> Tracking:
    """A controller that follows a motion.

    If no gains are given and the robot states all controllers, these are used. Otherwise the controller is the model's
    torque plus feedback with the given gains. A position gain that is not given has the bandwidth ``_BANDWIDTH``; a
    velocity gain that is not given damps critically.
    """
    stated = [actuator.controller for actuator in robot.actuators]
    if kp is None and kd is None and all(controller is not None for controller in stated):
        gains = np.array([[one.kp, one.kd] for one in stated if one is not None]).T
        return _law(motion, np.zeros_like(motion.q), np.zeros_like(motion.v), gains[0], gains[1])
    inertia = np.diagonal(mass_matrix(robot, motion.q[:1])[0])
    position = inertia * _BANDWIDTH**2 if kp is None else _gain("kp", kp, robot.nv)
    velocity = 2 * np.sqrt(np.maximum(position * inertia, 0.0)) if kd is None else _gain("kd", kd, robot.nv)
    return _law(motion, inverse_dynamics(robot, motion), motion.v, position, velocity)


def _law(motion: Motion, feedforward: Array, v_ref: Array, kp: Array, kd: Array) -> Tracking:
    """The law ``feedforward + kp (q_ref - q) + kd (v_ref - v)`` without limits."""
    rows = motion.q.shape
    none = np.zeros(rows)
    limits = np.full(rows[1], np.inf)
    gains = np.broadcast_to(kp, rows), np.broadcast_to(kd, rows)
    return Tracking(motion.t, feedforward, motion.q, v_ref, *gains, none, limits)


def _gain(name: str, given: object, nv: int) -> Float[Array, " nv"]:
    """A given gain as one number for each joint."""
    try:
        values = np.broadcast_to(np.asarray(given, dtype=float), (nv,))
    except (TypeError, ValueError):
        raise UsageError(f"{described(given)} was given as {name}, wanted one number or {nv}, one a joint.") from None
    if not (np.isfinite(values).all() and (values >= 0).all()):
        raise ParameterError(f"{name} is {described(given)}, wanted numbers of 0 or more.")
    return values


def _cause(robot: Robot, known: KnownEffect) -> Cause:
    """A known effect in the form that a simulation needs; an error for an effect on the geometry."""
    if known.effect in POSE_EFFECTS:
        raise UsageError(
            f"{known.effect} of {known.joint or 'the base'} was given to be simulated, and changes where links are, "
            "not their torque: load the corrected.urdf beside the corrected.yaml, and leave this entry out."
        )
    return Cause(effect_named(known.effect, robot), known.joint, np.array(known.theta))


def _cause_of_tuple(robot: Robot, given: object) -> Cause:
    """An effect from a tuple of effect, joint and parameters."""
    wanted = 'wanted effect, joint and parameters such as ("coulomb_friction", "j1", {"torque": 0.3})'
    if not isinstance(given, tuple | list) or len(given) != 3 or not isinstance(given[2], dict):
        raise UsageError(f"{described(given)} was given as an effect, {wanted}.")
    name, joint, parameters = given
    if not (joint is None or isinstance(joint, str)) or not all(map(NUMBERS.allows, parameters.values())):
        raise UsageError(f"{described(given)} was given as an effect, {wanted}.")
    values = {str(key): tuple(np.atleast_1d(np.asarray(value, dtype=float))) for key, value in parameters.items()}
    effect_name = name if isinstance(name, str) else getattr(name, "name", repr(name))
    found = degradation(robot, effect_name, joint, values)
    return Cause(found.effect, found.joint, np.array(found.theta))
