"""Numbers of bodies on the edge of what can exist: their intervals reach to one side of the estimate alone.

Beyond the edge lie bodies with a negative mass or a negative moment of inertia, or with a centre out of reach. A
deviation to both sides would call half of what no robot is likely.
"""

from __future__ import annotations

import numpy as np

from identification.diagnosis.columns.terms import Term, ordered
from identification.diagnosis.fit.possible_bodies import Body, bodies_of_terms, places_among, possible_minimum
from identification.diagnosis.judge.findings.bench import Shown
from identification.diagnosis.judge.findings.parameters import base_parameters
from identification.engine.numerics.bounded import solve
from identification.notes import Code, Note
from phantom_dyn.array_types import Array, Float, Int
from phantom_dyn.random_streams import random_stream

_DRAWS = 200
# Width of an interval of bodies that can exist, over that of all, above which it is not called one-sided.
_NARROWER = 0.8
_INTERVAL = (2.5, 97.5)  # per cent


def one_sided(shown: Shown) -> tuple[Note, ...]:
    """A note on each finding of inertial parameters whose intervals end where bodies cease to exist.

    Args:
        shown: The findings, with the fit of all their numbers.
    """
    free = [term for term in ordered(shown.named) if term.effect.inertial == "free"]
    return tuple(note for term in free if (note := _of(shown, term)) is not None)


def _of(shown: Shown, term: Term) -> Note | None:
    """The note on one finding; None if no interval ends early.

    Its interval is that of the same fit to other draws of the data, each among bodies that can exist.
    """
    robot, fitted = shown.problem.session.robot, shown.joint_fit
    at = fitted.place(term).coefficients
    own, cov = fitted.x[at], fitted.cov[at, at]
    squares, axes = np.linalg.eigh(cov)
    # The symmetric root, which does not turn with the rounding of the matrix as others do.
    root = (axes * np.sqrt(np.maximum(squares, 0.0))) @ axes.T
    drawn = own + random_stream("bodies that can exist").standard_normal((_DRAWS, len(own))) @ root
    bodies = places_among(np.array(term.columns), bodies_of_terms(robot, (term,)))
    precision, anywhere = solve(cov, np.eye(len(own))), np.full(len(own), np.inf)
    nearest = np.array([_nearest(one, precision, anywhere, bodies) for one in drawn])
    stated, mix = base_parameters(robot, term)
    (low, high), all_of_them = (np.percentile(some @ mix.T, _INTERVAL, axis=0) for some in (nearest, drawn))
    width = all_of_them[1] - all_of_them[0]
    intervals = [
        (one.name, float(low[k]), float(high[k]), one.unit)
        for k, one in enumerate(stated)
        if 0.0 < high[k] - low[k] < _NARROWER * width[k]
    ]
    return Note(Code.ONE_SIDED, term.joint, {"intervals": intervals}) if intervals else None


def _nearest(
    drawn: Float[Array, " k"],
    precision: Float[Array, "k k"],
    anywhere: Float[Array, " k"],
    bodies: list[tuple[Body, Int[Array, " 10"]]],
) -> Float[Array, " k"]:
    """What a fit among bodies that can exist makes of draws of the data whose fit without that limit is given."""
    if all(body.exists(drawn[at]) for body, at in bodies):
        return drawn
    return possible_minimum(precision, precision @ drawn, (-anywhere, anywhere), drawn, bodies)
