"""Lowers the probability of all findings if the given model fits only some recordings, as with a load in the others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identification.diagnosis.fit.gap import sample_weights
from identification.diagnosis.fit.problem import Problem
from identification.diagnosis.result import Judgement
from identification.engine import contract_levels
from identification.notes import Code, Note
from phantom_dyn.array_types import Array, Float

# A recording counts as fitted only from this share of the modelled torque in the other recordings: with less torque, a
# gap that is proportional to torque might not be visible.
_LEAST_TORQUE_SHARE = 0.5


def with_unlike_recordings(problem: Problem, judgement: Judgement) -> Judgement:
    """The judgement, with a note and less probable findings if the given model fits only some of the recordings.

    A finding acts in all recordings, so it would also show in the recordings that the model fits.

    Args:
        problem: Robot and recordings.
        judgement: Verdict, findings and noise of each joint.
    """
    notes = _unlike_notes(problem, judgement)
    if not notes:
        return judgement
    findings = tuple(
        replace(one, probability=min(one.probability, contract_levels.DOUBTED)) for one in judgement.findings
    )
    return replace(judgement, findings=findings, notes=(*judgement.notes, *notes))


def _unlike_notes(problem: Problem, judgement: Judgement) -> tuple[Note, ...]:
    """At most one note, which lists the recordings that the given model fits and those that it does not fit.

    The model fits a recording if its residual may be noise on every joint. The recording counts only if, on the joints
    with a gap, its modelled torque is large enough for this gap to be visible. There is no note if the findings explain
    all recordings, or if the user states what changed between them.
    """
    session = problem.session
    stated = bool(session.differences.effects)
    if len(session.logs) < 2 or stated or judgement.verdict not in ("unknown", "partly_explained"):
        return ()
    residuals, torques = session.in_judged_band(problem.columns.residual), problem.columns.model_torque
    logs = range(len(session.logs))
    residual_rms = np.stack([_rms(problem, k, residuals[k]) for k in logs])
    torque_rms = np.stack([_rms(problem, k, torques[k]) for k in logs])
    allowed = np.array([joint.allowed for joint in judgement.joints])
    gap = residual_rms > contract_levels.FLOORS_LEFT * allowed
    misfits = [k for k in logs if gap[k].any()]
    most = np.max(np.where(gap, torque_rms, 0.0), axis=0)
    has_torque = (torque_rms >= _LEAST_TORQUE_SHARE * most).all(axis=1)
    fits = [k for k in logs if has_torque[k] and (residual_rms[k] <= allowed).all()]
    if not fits or not misfits:
        return ()
    joints = tuple(joint for j, joint in enumerate(session.robot.joint_names) if gap[:, j].any())
    names = [recording.file for recording in session.recordings]
    numbers = {"fit": tuple(names[k] for k in fits), "misfit": tuple(names[k] for k in misfits), "joints": joints}
    return (Note(Code.RECORDINGS_UNLIKE, numbers=numbers),)


def _rms(problem: Problem, log: int, series: Float[Array, "n nv"]) -> Float[Array, " nv"]:
    """Root mean square of each joint over one recording, without samples of friction at standstill."""
    weights = sample_weights(problem, log)
    return np.sqrt((series**2 * weights).sum(axis=0) / np.maximum(weights.sum(axis=0), 1e-12))
