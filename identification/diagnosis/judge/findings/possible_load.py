"""Recognises a load with a moment of inertia of its own in the found change of the link that carries loads."""

from __future__ import annotations

import numpy as np

from identification.diagnosis.columns.terms import Term
from identification.estimators.consistent.consistent_bodies import PSEUDO, pseudo_inertia
from identification.notes import Code, Note
from phantom_dyn.array_types import Array, Float
from phantom_dyn.model.inertia import has_known_centre, payload_body
from phantom_dyn.model.robot import Robot

# A body counts as possible if no eigenvalue of its pseudo-inertia is negative by more than this many standard
# deviations.
_NEGATIVE_DEVIATIONS = 2.0


def possible_load_notes(robot: Robot, term: Term, changes: Float[Array, " k"], cov: Float[Array, "k k"]) -> list[Note]:
    """A note if the found change of the link that carries loads may be an additional body, such as a bar or a disc.

    The law of a payload is a point mass. Only free inertial parameters express the moment of inertia of a bar or a disc
    that turns about the last axis. No data distinguish such a load from a change of the link itself.

    Args:
        robot: The given model.
        term: Free inertial parameters.
        changes: Changes of these parameters, ``(k,)``.
        cov: Covariance of the changes, ``(k, k)``.
    """
    first = 10 * (payload_body(robot) - 1)
    if term.effect.regressor_columns(robot, term.joint) != tuple(range(first, first + 10)):
        return []
    mass, std = float(changes[0]), float(np.sqrt(cov[0, 0]))
    if mass <= 0.0 or not has_known_centre(mass, std):
        return []
    values, vectors = np.linalg.eigh(pseudo_inertia(changes))
    slopes = np.einsum("ia,kij,ja->ak", vectors, PSEUDO, vectors)
    stds = np.sqrt(np.einsum("ak,kl,al->a", slopes, cov, slopes))
    if np.any(values < -_NEGATIVE_DEVIATIONS * stds):
        return []
    numbers = {"mass": mass, "std": std, "center": tuple((changes[1:4] / mass).tolist())}
    return [Note(Code.POSSIBLE_LOAD, term.joint, numbers)]
