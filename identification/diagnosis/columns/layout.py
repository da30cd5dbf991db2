"""Which effects are tried in a session, with which shapes, and where their columns stand among all columns."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from identification.diagnosis.columns.common_causes import together
from identification.diagnosis.columns.own_effects import OwnEffect
from identification.diagnosis.columns.session import Session
from identification.diagnosis.columns.terms import SERIES, FoundEffect, Term, shapes_of
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.rival import Rival, Shape


@dataclass(frozen=True)
class Local:
    """Columns of one effect in one place with one shape that are not the rigid-body regressor's.

    Attributes:
        effect, joint, shape: What they are of.
        first: Index of the first among all columns.
        count: How many.
        rows: Which rows they touch.
    """

    effect: Rival
    joint: str | None
    shape: Shape
    first: int
    count: int
    rows: tuple[int, ...]


def lay_out(
    session: Session,
    operation: Operation,
    first_body: int,
    names: list[str],
    found: tuple[FoundEffect, ...],
    resonances: tuple[FoundEffect, ...],
) -> tuple[tuple[Term, ...], tuple[Local, ...]]:
    """Rivals and where their columns stand; appends the columns' names.

    Args:
        session: Says what can be where.
        operation: Of all recordings.
        first_body: Index of the first column of the rigid bodies.
        names: Of the columns so far; receives those of the effects.
        found: By the last fit, and rivals that did nearly as well.
        resonances: Compliances read off resonances.
    """
    robot = session.robot
    terms: list[Term] = []
    local: list[Local] = []
    start = _first(operation)
    for effect, joint, shapes in shapes_of(
        robot, operation, found, resonances, session.differences.own, together(session, operation)
    ):
        if effect.inertial is not None and not isinstance(effect, OwnEffect):
            columns = tuple(first_body + c for c in effect.regressor_columns(robot, joint))
            size = 4 if effect.inertial == "point mass" else len(columns)
            free = (np.inf,) * len(columns)
            terms.append(Term(effect, joint, (), columns, size, tuple(-x for x in free), free))
            continue
        for shape in shapes:
            signature = effect.signature(robot, start, joint, shape)
            count = len(signature.names)
            if count == 0:
                continue
            columns = tuple(range(len(names), len(names) + count))
            names += [f"{effect.name} {joint} {name}" for name in signature.names]
            bounds = effect.bounds_in(robot, operation, joint, shape) or ((-np.inf, np.inf),) * count
            lower, upper = zip(*bounds, strict=True)
            size = count + (0 if effect.shape_is_estimate else len(shape))
            size = 4 if effect.inertial == "point mass" else size
            terms.append(Term(effect, joint, shape, columns, size, lower, upper))
            local.append(Local(effect, joint, shape, columns[0], count, signature.rows))
    return tuple(terms), tuple(local)


def _first(operation: Operation) -> Operation:
    """A few samples, enough to see how many columns a signature has."""
    t, q, v, a, tau, expected, logged = (getattr(operation, name)[:8] for name in SERIES)
    base = None if operation.base is None else operation.base.at(slice(8))
    few = Operation(t, q, v, a, operation.robot, tau, expected, logged, base=base)
    return few if operation.temperature is None else replace(few, temperature=operation.temperature[:8])
