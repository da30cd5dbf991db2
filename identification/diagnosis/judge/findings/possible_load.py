"""Loads with an inertia of their own: changes of the link that carries a load, such as a body that exists makes."""

from __future__ import annotations

import numpy as np

from identification.diagnosis.columns.terms import Term
from identification.estimators.consistent.consistent_bodies import PSEUDO, pseudo_inertia
from identification.notes import Code, Note
from phantom_dyn.array_types import Array, Float
from phantom_dyn.model.inertia import has_known_centre, payload_body
from phantom_dyn.model.robot import Robot

# Standard deviations by which a principal value of a body that exists may be below zero.
_BELOW = 2.0


def possible_load_notes(robot: Robot, term: Term, own: Float[Array, " k"], cov: Float[Array, "k k"]) -> list[Note]:
    """A note where wrong inertial parameters of the link that carries a load are those of a body that exists.

    The law of a payload is a point mass. A bar or a disc on the last axis turns about itself, and only free inertial
    parameters express that. No data separate it from a link that differs by as much.

    Args:
        robot: The given model.
        term: Free inertial parameters.
        own: Their changes, ``(k,)``.
        cov: Covariance of these.
    """
    first = 10 * (payload_body(robot) - 1)
    if term.effect.regressor_columns(robot, term.joint) != tuple(range(first, first + 10)):
        return []
    mass, std = float(own[0]), float(np.sqrt(cov[0, 0]))
    if mass <= 0.0 or not has_known_centre(mass, std):
        return []
    values, vectors = np.linalg.eigh(pseudo_inertia(own))
    slopes = np.einsum("ia,kij,ja->ak", vectors, PSEUDO, vectors)
    if np.any(values < -_BELOW * np.sqrt(np.einsum("ak,kl,al->a", slopes, cov, slopes))):
        return []
    numbers = {"mass": mass, "std": std, "center": tuple((own[1:4] / mass).tolist())}
    return [Note(Code.POSSIBLE_LOAD, term.joint, numbers)]
