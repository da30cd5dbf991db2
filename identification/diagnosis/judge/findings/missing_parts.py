"""Finds parts of the model, on fixed or locked joints, whose absence explains wrong inertial parameters."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from identification.diagnosis.columns.terms import Term, ordered
from identification.diagnosis.fit.full_fit import FullFit
from identification.diagnosis.fit.problem import Problem
from identification.diagnosis.search.record import EffectJoint
from identification.diagnosis.search.search import Search
from identification.diagnosis.search.swaps import with_replacement
from identification.gates import special_case
from identification.gates.special_case import more_than_a_missing_part
from identification.notes import Code, Note
from phantom_dyn.array_types import Array, Float
from phantom_dyn.model.attached import Attached
from phantom_dyn.model.inertia import body_parameters, payload_body


def likeliest_missing_part(
    problem: Problem, term: Term, changes: Float[Array, " k"]
) -> tuple[float, int, Attached] | None:
    """The part of the model whose absence explains most of the torque of wrong inertial parameters.

    Args:
        problem: Holds the products of columns.
        term: Free inertial parameters.
        changes: Changes of these parameters, ``(k,)``.

    Returns:
        Explained share of the squared torque, index of the body, and the part; None if the model has no such part.
    """
    robot = problem.session.robot
    # The inertial parameters of all bodies are the columns after the nuisances.
    first = problem.nuisance_count
    columns = np.arange(first, first + 10 * (robot.model.njoints - 1))
    a = problem.total_a[np.ix_(columns, columns)]
    change = np.zeros(len(columns))
    change[np.array(term.columns) - first] = changes
    energy = max(float(change @ a @ change), 1e-300)
    found: list[tuple[float, int, Attached]] = []
    for body in range(1, robot.model.njoints):
        for part in robot.attached[body]:
            # The absence of the part is a change by minus its parameters: what remains of the change is the sum.
            remainder = change.copy()
            remainder[10 * (body - 1) : 10 * body] += body_parameters(part.mass, part.center, part.inertia)
            found.append((1.0 - float(remainder @ a @ remainder) / energy, body, part))
    return max(found, key=lambda entry: entry[0], default=None)


def payload_term(search: Search) -> Term | None:
    """The payload among the rivals of a search; None if there is none."""
    return next((term for term in search.terms if term.effect.inertial == "point mass"), None)


def missing_part_shares(plain: Search, kept: Iterable[Term], fitted: FullFit) -> dict[Term, float]:
    """For each finding of inertial parameters, the share of its squared torque that the absence of a part explains.

    Ten free parameters of a link explain a little more than a known part does, as links are never exactly as modelled.
    But a part that is not mounted is the more probable cause.

    Args:
        plain: Fits in the judged band.
        kept: The findings.
        fitted: Fit of all their parameters.

    Returns:
        The shares; empty if no payload is among the rivals.
    """
    if payload_term(plain) is None:
        return {}
    free = [term for term in ordered(kept) if term.effect.inertial == "free"]
    return {term: _share_of_part(plain.problem, term, fitted.coefficients(term)) for term in free}


def bodies_expressing_part(search: Search, chosen: frozenset[Term], payload: Term) -> frozenset[EffectJoint]:
    """Free inertial parameters that only express the absence of a part, which a payload in the set expresses, too.

    Args:
        search: Rivals and fits.
        chosen: The set.
        payload: The payload in the set.
    """
    free = [term for term in search.terms if term.effect.inertial == "free"]
    fits = {term: search.held_out_fit(with_replacement(chosen, payload, frozenset([term]))) for term in free}
    shares = {term: _share_of_part(search.problem, term, fit.theta[list(term.columns)]) for term, fit in fits.items()}
    return frozenset(term.effect_joint for term, part in shares.items() if not more_than_a_missing_part(part).passed)


def _share_of_part(problem: Problem, term: Term, changes: Float[Array, " k"]) -> float:
    """Share of `likeliest_missing_part` if that part is on the link that carries payloads, else zero."""
    found = likeliest_missing_part(problem, term, changes)
    return found[0] if found is not None and found[1] == payload_body(problem.session.robot) else 0.0


def missing_part_notes(problem: Problem, term: Term, changes: Float[Array, " k"]) -> list[Note]:
    """A note if the absence of a part explains most of what inertial parameters explain."""
    found = likeliest_missing_part(problem, term, changes)
    if found is None or found[0] < special_case.PART_SHARE:
        return []
    share, _, part = found
    return [Note(Code.MISSING_PART, term.joint, {"share": share, "parts": tuple(part.names), "mass": part.mass})]
