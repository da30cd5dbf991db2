"""Distance of simulated from recorded motion, relative to the distance that noise alone causes with a right model.

Noise acts in three ways: in the initial state of a simulation, as torque during it, and through the uncertainty of the
moves within the tolerances. Each is simulated once in every window. A share of a joint's travel is added for errors of
filters and of the simulation's steps.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from identification.diagnosis import decision_rules as rules
from identification.diagnosis.result import Judgement
from identification.rollout.compare import Rollout
from identification.rollout.rollout_starts import Window
from identification.rollout.shots import Shot, under_torque
from identification.rollout.simulated_models import Model
from phantom_dyn.array_types import Array, Float
from phantom_dyn.random_streams import random_stream

# Probability that a right model exceeds its band on some joint; the rest of 5 % in total is for torques.
_LEVEL = 0.01


def strays(
    shots: tuple[Shot, ...],
    models: Callable[[Window, int], Model],
    torque: Callable[[Shot, Model], Float[Array, "_ nv"]],
    noise: tuple[Float[Array, "_ nv"], ...],
    folds: tuple[int, ...],
    horizon: float,
) -> Float[Array, " nv"]:
    """Distance of each joint's simulated from its recorded motion, in units of the end of its 99 % noise band.

    Args:
        shots: Windows.
        models: Model for a window, by the fit that has not seen a fold.
        torque: Torque of the drives over the recording of a window.
        noise: Torque that counts as noise, of each recording.
        folds: At least two.
        horizon: Time over which windows are compared [s].

    Raises:
        ParameterError: If a motion leaves all bounds.
    """
    from scipy.special import fdtri

    rng = random_stream("noise of rollout starts")
    squares: list[list[Array]] = []
    for shot in shots:
        window = shot.window
        model, other = (models(window, fold) for fold in _two(window.fold, folds))
        kept = slice(1, int(np.searchsorted(shot.t, horizon + 1e-9)))
        drive = torque(shot, model)
        right = under_torque(shot, model, drive)
        nudge = rng.choice([-1.0, 1.0], right.shape[1:]) * np.array([shot.states.q_std, shot.states.v_std])
        # Noise from another time has the same size and spectrum, and is independent of that in this window.
        pushed = np.roll(noise[window.log], len(drive) // 2, axis=0)
        # Factor from the difference of two leave-one-fold-out fits to the error of a fit (jackknife).
        spread = np.sqrt(0.5 * (len(folds) - 1))
        parts = (
            right - shot.read,
            under_torque(shot, model, drive, nudge) - right,
            under_torque(shot, model, drive + pushed) - right,
            spread * (under_torque(shot, other, drive) - right),
            np.broadcast_to(shot.states.scatter, right.shape),
            rules.MODEL_SHARE * (shot.read - shot.read[0]),
        )
        squares.append([np.mean(part[kept] ** 2, axis=0) for part in parts])
    error, *expected = np.mean(squares, axis=0)
    count = len(shots)
    band = np.sqrt(1.0 / fdtri(count, count, _LEVEL / len(error)))
    return np.sqrt(error / np.maximum(np.sum(expected, axis=0), 1e-300)) / band


def _two(fold: int, folds: tuple[int, ...]) -> tuple[int, int]:
    """The fold of a window and another one; a fold that no fit has seen is paired with the first."""
    if fold not in folds:
        return fold, folds[0]
    return fold, folds[(folds.index(fold) + 1) % len(folds)]


def borne_out_by_motion(judgement: Judgement, rollout: Rollout) -> Judgement:
    """The judgement, with ``unknown`` instead of ``no_gap`` where simulated motion leaves its noise band by far."""
    if judgement.verdict != "no_gap" or max(rollout.strays.values(), default=0.0) < rules.STRAYS_FAR:
        return judgement
    joint = max(rollout.strays, key=lambda name: rollout.strays[name])
    return replace(judgement, verdict="unknown", unexplained=replace(judgement.unexplained, joint=joint))
