"""A note if the given model fits some recordings and not others, for example because the robot carried a load."""

from __future__ import annotations

import numpy as np

from identification.diagnosis.fit.gap import sample_weights
from identification.diagnosis.fit.problem import Problem
from identification.diagnosis.result import Judgement
from identification.engine import contract_levels
from identification.notes import Code, Note
from phantom_dyn.array_types import Array, Float

# A gap in proportion to the torque would show in recordings with at least this share of the others' modelled torque.
_AS_MUCH = 0.5


def unlike_notes(problem: Problem, judgement: Judgement) -> tuple[Note, ...]:
    """A note on the recordings that the given model fits, where it does not fit others; at most one.

    A recording fits if the residual of the given model may be noise on every joint. It counts only if the model needs
    about as much torque on the joints with a gap as in the other recordings. There is no note if the findings explain
    all recordings, or if the user states what changed between them.

    Args:
        problem: Robot and recordings.
        judgement: Verdict and noise of each joint.
    """
    session = problem.session
    stated = bool(session.differences.own)
    if len(session.logs) < 2 or stated or judgement.verdict not in ("unknown", "partly_explained"):
        return ()
    given, torque = session.in_judged_band(problem.columns.residual), problem.columns.model_torque
    logs = range(len(session.logs))
    left, whole = (np.stack([_rms(problem, k, series[k]) for k in logs]) for series in (given, torque))
    allowed = np.array([joint.allowed for joint in judgement.joints])
    gap = left > contract_levels.FLOORS_LEFT * allowed
    misfits = [k for k in logs if gap[k].any()]
    most = np.max(np.where(gap, whole, 0.0), axis=0)
    fits = [k for k in logs if (left[k] <= allowed).all() and (whole[k] >= _AS_MUCH * most).all()]
    if not fits or not misfits:
        return ()
    joints = tuple(joint for j, joint in enumerate(session.robot.joint_names) if gap[:, j].any())
    names = [recording.file for recording in session.recordings]
    numbers = {"fit": tuple(names[k] for k in fits), "misfit": tuple(names[k] for k in misfits), "joints": joints}
    return (Note(Code.RECORDINGS_UNLIKE, numbers=numbers),)


def _rms(problem: Problem, log: int, series: Float[Array, "n nv"]) -> Float[Array, " nv"]:
    """Root mean square of each joint over one recording, friction at standstill left out."""
    weights = sample_weights(problem, log)
    return np.sqrt((series**2 * weights).sum(axis=0) / np.maximum(weights.sum(axis=0), 1e-12))
