"""Transmission stiffness from resonances in a joint's frequency response, as additional shapes for the search.

The grid of transmission compliances that the search tries is coarse. A recording that excites a resonance determines
the stiffness to a few per cent, whatever the model of the links is. The search tries that compliance in addition, and
scores it like all others.

The frequency response is from drive torque to motor position. It needs an encoder on the motor, and excitation (noise,
a chirp) up to well above the resonance while the other joints hold still. Dry friction and cogging lower the coherence.
If a joint moves far, its inertia changes with the posture, and the linear model does not hold.
"""

from __future__ import annotations

import numpy as np

from identification.data.log import Log
from identification.diagnosis import decision_rules as rules
from identification.diagnosis.columns.terms import FoundEffect
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.simulated import SWING_DAMPING
from phantom_dyn.effects.support.displaced import behind_encoder
from phantom_dyn.errors import EstimationError, LogError, ParameterError, RobotError
from phantom_dyn.haptics.experiments.frequency_response import (
    FrequencyResponse,
    estimate_frequency_response,
    fit_continuous_two_mass,
)
from phantom_dyn.model.robot import Robot

# Highest frequency used, as a share of the sampling rate: up to there a sampled torque is accurate to a per cent.
_HIGHEST = 0.2
# Smallest number of lengths of a segment in a recording: spectra are averaged over segments.
_SEGMENTS = 12
_LONGEST = 8.0  # largest length of a segment [s]: lines of the spectrum are then an eighth of a hertz apart


def resonances(robot: Robot, logs: tuple[Log, ...]) -> tuple[FoundEffect, ...]:
    """Transmission compliance of every joint with an encoder on its motor, for each recording that shows a resonance.

    Args:
        robot: States which encoders are on the motor.
        logs: Recordings ready for fitting.
    """
    effect = effect_named("transmission_compliance")
    out = []
    for log in logs:
        for row, joint in enumerate(robot.joint_names):
            stiffness = None if behind_encoder(robot, row) else _stiffness(log, joint)
            if stiffness is not None:
                compliance = 1.0 / stiffness
                out.append(FoundEffect(effect, joint, (compliance, SWING_DAMPING), np.array([compliance])))
    return tuple(out)


def _stiffness(log: Log, joint: str) -> float | None:
    """Stiffness of one transmission; None if the recording does not show it."""
    try:
        response = joint_response(log, joint)
        if np.mean(response.coherence >= rules.COHERENT) < rules.EXCITED_SHARE:
            return None
        # The fit may overflow if the joint is not two masses on a spring; a bad fit raises an error.
        with np.errstate(all="ignore"):
            return fit_continuous_two_mass(response).axis.cable_stiffness
    except (EstimationError, LogError, ParameterError):
        return None


def joint_response(log: Log, joint: str) -> FrequencyResponse:
    """Empirical transfer function of one joint, torque to position, up to a fifth of the sampling rate.

    Args:
        log: A recording in which this joint is driven by noise or a chirp.
        joint: Name of the joint.

    Raises:
        RobotError: If the recording has no such joint.
        LogError: If its longest valid stretch is under 256 samples, or its torque is constant.
    """
    if joint not in log.joint_names:
        raise RobotError(f"{log.file} has no joint {joint!r}: it has {', '.join(log.joint_names)}.")
    column = log.joint_names.index(joint)
    stretch = _longest_valid(log)
    count = stretch.stop - stretch.start
    if count < 256:
        raise LogError(f"{log.file}: the longest valid stretch has {count} samples: record 256 or more without a gap.")
    torque = log.tau[stretch, column]
    if np.ptp(torque) == 0:
        raise LogError(f"{log.file}: the torque of {joint} never changes: drive it with noise or a chirp.")
    t = log.motion.t
    period = float((t[-1] - t[0]) / (len(t) - 1))
    position = (log.motion.q if log.raw_q is None else log.raw_q)[stretch, column]
    length = min(count * period / _SEGMENTS, _LONGEST)
    response = estimate_frequency_response(torque, position, period=period, segment=length)
    return response.between(0.0, 2 * np.pi * _HIGHEST / period)


def _longest_valid(log: Log) -> slice:
    """The longest run of valid samples, the first of several of equal length; empty without valid samples."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], log.valid, [False]]).astype(int)))
    runs = edges.reshape(-1, 2).tolist()
    return max((slice(*run) for run in runs), key=lambda run: run.stop - run.start, default=slice(0, 0))
