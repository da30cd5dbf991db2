"""Fits a model to the recordings without a load, so that a diagnosis finds only the unknown load of the others.

The fit covers the inertial parameters of all links, and friction and a constant torque of every joint. The links stay
physically consistent, with a prior at the given parameters. All recordings are then diagnosed with the fitted model, so
that errors of the given model, which affect all recordings, do not count as a change.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identification.data.changes import Change
from identification.data.recording import Recording
from identification.data.signals import process_all, within_limits
from identification.diagnosis.columns.prepared import Prepared
from identification.diagnosis.columns.terms import KnownEffect
from identification.estimators.consistent.consistent import consistent
from identification.notes import Code, Note
from identification.regression.regressor import torque_regressor
from phantom_dyn.dynamics.dynamics import standard_parameters
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.support.changed_robot import with_friction, with_parameters
from phantom_dyn.errors import LogError
from phantom_dyn.model.robot import Robot

# Prior standard deviation of the links' parameters as a share of the given ones: wide, as the model may be inaccurate.
_PRIOR_STD = 0.5
_OFFSET = "torque_offset"
_FRICTION = ("viscous_friction", "coulomb_friction")


def has_unknown_load(changes: tuple[Change, ...]) -> bool:
    """True if at least one recording is stated to carry an unknown load."""
    return any("payload" in change.unknown for change in changes)


def with_common_model(given: Prepared) -> Prepared:
    """The input of a diagnosis with the fitted model of `common_model` in place of the given one.

    Raises:
        LogError: If every recording carries a load.
    """
    robot, offsets, note = common_model(given.robot, given.fitted, given.changes)
    return replace(given, robot=robot, known=(*given.known, *offsets), notes=(note, *given.notes))


def common_model(
    robot: Robot, recordings: tuple[Recording, ...], changes: tuple[Change, ...]
) -> tuple[Robot, tuple[KnownEffect, ...], Note]:
    """The robot fitted to the recordings without a load, constant torques of its joints, and a note on this fit.

    Args:
        robot: The given model.
        recordings: Recordings of the diagnosis, in the order of the changes.
        changes: Known changes of each recording.

    Raises:
        LogError: If every recording carries a load.
    """
    pairs = zip(recordings, changes, strict=False)
    unloaded = tuple(one for one, change in pairs if "payload" not in change.unknown and change.payload is None)
    if not unloaded:
        raise LogError(
            f"{changes[0].file}: every recording carries a load without a value, so that there is nothing to compare "
            "it with: add a recording without a load."
        )
    zero = np.zeros(robot.nv)
    frictionless = replace(robot, viscous_friction=zero, coulomb_friction=zero)
    logs, _ = process_all(unloaded, frictionless)
    logs = tuple(replace(log, tau=within_limits(log.tau, frictionless)) for log in logs)
    effects = [(effect_named(name), joint) for joint in robot.joint_names for name in (*_FRICTION, _OFFSET)]
    found = consistent(torque_regressor(frictionless, logs, effects), prior=1.0 / _PRIOR_STD**2)
    count = len(standard_parameters(frictionless))
    out = with_parameters(frictionless, found.pi[:count] - standard_parameters(frictionless))
    offsets = []
    for joint, (viscous, coulomb, offset) in zip(robot.joint_names, found.pi[count:].reshape(robot.nv, 3), strict=True):
        out = with_friction(out, joint, viscous=float(viscous), coulomb=float(coulomb))
        offsets.append(KnownEffect(_OFFSET, joint, (float(offset),)))
    return out, tuple(offsets), Note(Code.MODEL_IN_COMMON, None, {"files": [one.file for one in unloaded]})
