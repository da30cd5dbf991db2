"""How heavy a payload may be that moves within tolerance take up: what a fit beside these moves leaves open.

A load that all links of a linkage share is taken up by many moves at once, by more than the tolerance of any one mass.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identification.diagnosis.columns.terms import Term
from identification.diagnosis.result import Adjusted, Hidden
from identification.diagnosis.search.search import Search

_DEVIATIONS = 2.0
"""Above the estimate: what 95 % of payloads that look like this one stay below."""


def with_hidden_payload(moves: tuple[Adjusted, ...], search: Search, chosen: frozenset[Term]) -> tuple[Adjusted, ...]:
    """The moves with the heaviest payload that could hide behind those of masses that end at their limits.

    Args:
        moves: As found so far, with the mass that each of them alone takes up.
        search: Fits a payload beside the moves.
        chosen: What is shown; a payload among it does not hide.
    """
    loads = [term for term in search.terms if term.effect.inertial == "point mass"]
    masses = [move for move in moves if move.at_limit and _mass(move) is not None]
    if not loads or not masses or any(term in chosen for term in loads):
        return moves
    found = search.evaluate(chosen | {loads[0]})
    column = loads[0].columns[0]
    at = int(np.searchsorted(found.active, column))
    most = float(found.theta[column]) + _DEVIATIONS * float(np.sqrt(found.cov[at, at]))
    alone = max(_mass(move) or 0.0 for move in masses)
    if not (np.isfinite(most) and most > alone):
        return moves
    return tuple(replace(move, hides=Hidden("payload", most)) if move in masses else move for move in moves)


def _mass(move: Adjusted) -> float | None:
    """The heaviest payload that a move could hide [kg]; None where it hides none."""
    return None if move.hides is None or move.hides.kind != "payload" else move.hides.size
