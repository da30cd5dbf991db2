"""Regression columns of everything that may explain a residual: tolerance parameters of the model and every effect.

A row is one joint's torque. The residual of a row is measured minus modelled torque, in the frequency band of its
recording. A fit explains the residual by a sum of columns times unknown coefficients. Columns of one recording are
computed once; all fits use their Gram matrices. An effect gives its columns as a `Signature`: arrays at the full rate,
and the rows on which they act. The judged band is the lower part of the band, in which the corrected model is judged.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from identification.data.log import Band
from identification.data.unknown_drives import unknown_drives
from identification.diagnosis.columns.layout import TermColumns, lay_out
from identification.diagnosis.columns.motion.one_sine import moving, uninformative_sines, without_motion
from identification.diagnosis.columns.motion.standstill import (
    friction_sign_unknown,
    held_std,
    reversal_std,
    standstill_std,
    usable_samples,
)
from identification.diagnosis.columns.operations import (
    friction_torque_with,
    operation_of,
    true_robot_and_motion,
    with_expected_torque,
)
from identification.diagnosis.columns.residual_within_tolerances import residual_within_tolerances
from identification.diagnosis.columns.session import Series, Session
from identification.diagnosis.columns.terms import FoundEffect, Term, merged
from identification.diagnosis.columns.tolerance_parameters import (
    ToleranceParameter,
    bodies_on,
    parameters_by_joint,
    tolerance_columns,
    tolerance_parameters,
)
from identification.engine.numerics.two_threads import in_two_threads
from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.dynamics.dynamics import rigid_body_regressor
from phantom_dyn.effects.effect import Effect
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.rival import Shape
from phantom_dyn.model.inertia import parameter_names
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion
from phantom_dyn.signals.splines import interpolated

_PIECE = 4096  # samples at the full rate whose regressor is in memory at once
ColumnKey = tuple[str, str | None, Shape]  # effect, joint and shape


@dataclass(frozen=True)
class Columns:
    """Columns of all recordings of one robot, row by row.

    Attributes:
        names: Name of each column: first tolerance parameters, then the rigid-body regressor, then effects.
        tolerance_parameters: The parameter of each of the first columns.
        terms: All candidate effects.
        rows: For each row, the indices of the columns that touch it.
        values: For each log and row, in-band samples of those columns, ``values[log][row] (n, len(rows[row]))``.
        residual: For each log, measured minus modelled torque in the band, ``(n, nv)``.
        model_torque: For each log, modelled torque in the band, ``(n, nv)``.
        usable: For each log, samples that may be used on each row, ``(n, nv)``.
        reversal_std: For each log, standard deviation of the modelled torque where friction changes sign, ``(n, nv)``.
        standstill_std: For each log, standard deviation of the friction torque of joints at standstill, ``(n, nv)``.
        operations: For each log, motion and torque at the full rate.
        term_columns: For each term whose columns are not those of the rigid-body regressor, where its columns are.
        displaced: Names and joints of the effects that displace links or turn gravity. The columns of tolerance
            parameters and rigid bodies are computed at the true positions and gravity according to these effects.
    """

    names: tuple[str, ...]
    tolerance_parameters: tuple[ToleranceParameter, ...]
    terms: tuple[Term, ...]
    rows: tuple[tuple[int, ...], ...]
    values: tuple[tuple[Float[Array, "n k"], ...], ...]
    residual: tuple[Float[Array, "n nv"], ...]
    model_torque: tuple[Float[Array, "n nv"], ...]
    usable: tuple[Bool[Array, "n nv"], ...]
    reversal_std: tuple[Float[Array, "n nv"], ...]
    standstill_std: tuple[Float[Array, "n nv"], ...]
    operations: tuple[Operation, ...]
    term_columns: tuple[TermColumns, ...]
    displaced: tuple[tuple[str, str | None], ...] = ()

    @property
    def model_count(self) -> int:
        """Number of columns of tolerance parameters and rigid bodies, which come first."""
        return min((block.first for block in self.term_columns), default=len(self.names))


@dataclass(frozen=True)
class FitPoint:
    """The point about which nonlinear laws are linearised.

    Attributes:
        found: Effects of the last fit.
        runners_up: Rivals that were nearly as good.
        residual: Residual of the last fit for each log, in the band; None: it is computed from a fit of the tolerance
            parameters alone.
        resonances: Transmission compliances determined from resonances, which are tried in addition to the grid.
    """

    found: tuple[FoundEffect, ...] = ()
    runners_up: tuple[FoundEffect, ...] = ()
    residual: Series | None = None
    resonances: tuple[FoundEffect, ...] = ()


def build_columns(session: Session, about: FitPoint = FitPoint(), before: Columns | None = None) -> Columns:
    """Columns of every tolerance parameter and of every effect on every joint.

    Columns made of accelerations are low-passed to the judged band. Above that band they are encoder noise. The
    residual contains the same noise, so a fit would explain it by an inertia that is too large.

    Args:
        session: Robot and logs.
        about: Point about which nonlinear laws are linearised.
        before: Columns of the same session for an earlier point; columns that do not depend on the point are reused.
    """
    robot = session.robot
    displacing = _displacing(robot, about.found)
    given = _given_part(session) if before is None else _given_part_of(before)
    if before is None or before.displaced or displacing:
        # A wrong mass acts at the true position of its link, so tolerance parameters and rigid bodies are computed
        # there. The displacing effect itself is computed from the given model. The sum of both is exact.
        parts = tuple(model_columns(session, k, o, displacing) for k, o in enumerate(given.operations))
        given = replace(given, of_model=parts)
    operations = tuple(with_expected_torque(o, about.found) for o in given.operations)
    residual = about.residual
    if residual is None:
        residual = residual_within_tolerances(robot, given.of_model, given.residual, given.usable)
    operations = tuple(
        o.after_fit(o.expected, interpolated(o.t, o.t[log.samples], part))
        for log, o, part in zip(session.logs, operations, residual, strict=True)
    )
    tolerances = [parameter.name for parameter in tolerance_parameters(robot)]
    names = [*tolerances, *parameter_names(robot)]
    found = (*about.found, *about.runners_up)
    terms, term_columns = lay_out(session, merged(operations), len(tolerances), names, found, about.resonances)
    given = replace(given, operations=operations)
    values = tuple(
        _values(session, k, o, own, term_columns, {} if before is None else _kept(before, k))
        for k, (o, own) in enumerate(zip(operations, given.of_model, strict=True))
    )
    return _assembled(session, given, tuple(names), terms, term_columns, values, about.found)


def columns_like(session: Session, like: Columns, found: tuple[FoundEffect, ...] = ()) -> Columns:
    """Columns of other logs of the same robot, with the effects and shapes of ``like``.

    Args:
        session: The other logs.
        like: Columns with the same effects, places and shapes.
        found: Effects of a fit, from which the commanded torque of the drives is computed.
    """
    out, values = columns_by_log(session, like, found)
    return replace(out, values=tuple(map(values, range(len(session.logs)))))


def columns_by_log(
    session: Session, like: Columns, found: tuple[FoundEffect, ...] = ()
) -> tuple[Columns, Callable[[int], tuple[Float[Array, "n k"], ...]]]:
    """The columns of `columns_like` without their values, and a function that computes the values of one log.

    The values of all logs together may not fit in memory.
    """
    given, displacing = _given_part(session), _displacing(session.robot, found) if like.displaced else ()
    operations = tuple(with_expected_torque(o, found) for o in given.operations)
    expected = replace(given, operations=operations)

    def values_of(log: int) -> tuple[Array, ...]:
        of_model = model_columns(session, log, given.operations[log], displacing)
        return _values(session, log, operations[log], of_model, like.term_columns, {})

    return _assembled(session, expected, like.names, like.terms, like.term_columns, (), found), values_of


@dataclass(frozen=True)
class _GivenPart:
    """The parts of `Columns` that no fit changes: motion, torque and the columns of the given model.

    Attributes:
        operations, model_torque, residual, usable, reversal_std: As in `Columns`.
        of_model: For each log and row, the columns of tolerance parameters and rigid bodies.
    """

    operations: tuple[Operation, ...]
    of_model: tuple[list[list[Float[Array, " n"]]], ...]
    model_torque: Series
    residual: Series
    usable: tuple[Bool[Array, "n nv"], ...]
    reversal_std: Series


def _given_part(session: Session) -> _GivenPart:
    """The parts that no fit changes; the columns of model parameters are still empty."""
    robot, logs = session.robot, session.logs
    robots = [session.differences.robot(robot, k) for k in range(len(logs))]
    moves = moving(logs)
    # Rows that are not used: another recording shows more of the joint.
    unused = uninformative_sines(logs, moves)
    without_unused = [without_motion(log) if (unused[k] | ~moves[k]).all() else log for k, log in enumerate(logs)]
    operations = tuple(
        operation_of(robots[k], log, session.known, k, session.cutoff_hz) for k, log in enumerate(without_unused)
    )
    torque = tuple(log.band(o.tau) for log, o in zip(logs, operations, strict=True))
    return _GivenPart(
        operations,
        (),
        torque,
        residual=tuple(log.band(log.tau) - model for log, model in zip(logs, torque, strict=True)),
        usable=tuple(
            usable_samples(log) & ~unknown_drives(robot) & ~own for log, own in zip(logs, unused, strict=True)
        ),
        # A drive that switches between two readings of the torque adds to this uncertainty.
        reversal_std=tuple(
            log.band(reversal_std(o) if log.switching is None else reversal_std(o) + log.switching)
            for log, o in zip(logs, operations, strict=True)
        ),
    )


def _given_part_of(before: Columns) -> _GivenPart:
    """The parts that no fit changes, from earlier columns of the same session."""
    counts = [sum(column < before.model_count for column in row) for row in before.rows]
    of_model = tuple([[*part[:, :count].T] for part, count in zip(log, counts, strict=True)] for log in before.values)
    return _GivenPart(
        before.operations,
        of_model,
        before.model_torque,
        before.residual,
        before.usable,
        before.reversal_std,
    )


def _assembled(
    session: Session,
    given: _GivenPart,
    names: tuple[str, ...],
    terms: tuple[Term, ...],
    term_columns: tuple[TermColumns, ...],
    values: tuple[tuple[Float[Array, "n k"], ...], ...],
    found: tuple[FoundEffect, ...],
) -> Columns:
    """All columns, row by row."""
    robot, parameters = session.robot, tolerance_parameters(session.robot)
    rows = []
    for j, acting in enumerate(parameters_by_joint(robot, parameters)):
        mine = [*acting, *(len(parameters) + k for k in _parameters_on(robot, j))]
        for block in term_columns:
            if j in block.rows:
                mine += range(block.first, block.first + block.count)
        rows.append(tuple(mine))
    return Columns(
        names,
        parameters,
        terms,
        tuple(rows),
        values,
        given.residual,
        given.model_torque,
        given.usable,
        given.reversal_std,
        # Friction includes that of the last fit.
        tuple(
            np.maximum(
                standstill_std(log, friction_sign_unknown(robot, log), friction_torque_with(operation, found)),
                held_std(robot, log, residual),
            )
            for log, operation, residual in zip(session.logs, given.operations, given.residual, strict=True)
        ),
        given.operations,
        term_columns,
        tuple(point.effect_joint for point in _displacing(session.robot, found)),
    )


def _displacing(robot: Robot, found: tuple[FoundEffect, ...]) -> tuple[FoundEffect, ...]:
    """Found effects that displace the links from the positions that the encoders read, or turn gravity.

    An encoder error that gives the same reading at several positions is left out: the true speed would be infinite.
    """
    out = []
    for point in found:
        effect = point.effect
        if isinstance(effect, Effect) and effect.displaces:
            theta = effect.from_coefficients(robot, point.joint, point.coefficients, point.shape)
            out += [point] if effect.reads_one_place(theta) else []
    return tuple(out)


def model_columns(
    session: Session,
    log: int,
    operation: Operation,
    displacing: tuple[FoundEffect, ...] = (),
    *,
    beyond: float = 1.0,
) -> list[list[Float[Array, " n"]]]:
    """Columns of the tolerance parameters and of the rigid-body regressor in the band, row by row.

    Args:
        session: Robot and logs.
        log: Index of the log.
        operation: Motion and modelled torque of that log.
        displacing: Effects that displace the links.
        beyond: Cutoff of columns made of accelerations, divided by the edge of the judged band.
    """
    robot, band = session.robot, session.logs[log].band
    narrow = partial(session.log_below, log=log, edge_hz=beyond * session.cutoff_hz)
    there = true_robot_and_motion(robot, operation, displacing)
    regressor = narrow(_regressor_in_band(*there, band, operation.per_load))
    bodies = regressor.transpose(1, 0, 2)
    nuisances = tolerance_columns(robot, operation, bodies, session.logs[log], narrow)
    return [[*nuisances[j], *bodies[j].T[list(_parameters_on(robot, j))]] for j in range(robot.nv)]


def _regressor_in_band(
    robot: Robot, motion: Motion, band: Band, per_load: Float[Array, "N nv"] | None
) -> Float[Array, "n nv p"]:
    """The rigid-body regressor in the band, from pieces of the motion: at the full rate it is large.

    Args:
        robot: The given model.
        motion: Motion of its links.
        band: Filter of the recording.
        per_load: Derivative of the drive torque with respect to the torque on the link; None: it is one.
    """
    inside = band.samples(len(motion.t))
    parts = []
    for at in np.array_split(inside, len(motion.t) // _PIECE + 1):
        rows = slice(at[0] - band.half, at[-1] + band.half + 1)
        regressor = rigid_body_regressor(robot, motion.at(rows))
        parts.append(band(regressor if per_load is None else regressor * per_load[rows, :, None]))
    return np.concatenate(parts)


def _parameters_on(robot: Robot, row: int) -> tuple[int, ...]:
    """Columns of the rigid-body regressor that may change the torque of a joint."""
    return tuple(10 * (body - 1) + k for body in bodies_on(robot, row) for k in range(10))


def effect_columns(
    session: Session, log: int, operation: Operation, block: TermColumns, edge_hz: float
) -> tuple[Float[Array, "n c"], ...]:
    """In-band columns of one effect in one log, an array for each row.

    Columns made of accelerations are low-passed to ``edge_hz``, except their `Signature.steps`.
    """
    band = session.logs[log].band
    signature = block.effect.signature(operation.robot, operation, block.joint, block.shape)
    out = []
    for k in range(len(signature.rows)):
        column = band(signature.columns[:, k, :])
        if block.effect.uses_acceleration:
            steps = 0.0 if signature.steps is None else band(signature.steps[:, k, :])
            column = session.log_below(column - steps, log, edge_hz) + steps
        out.append(column)
    return tuple(out)


def _kept(before: Columns, log: int) -> dict[ColumnKey, tuple[Float[Array, "n c"], ...]]:
    """Columns of one log that do not depend on the last fit, by effect, joint and shape; an array for each row."""
    out: dict[ColumnKey, tuple[Array, ...]] = {}
    for block in before.term_columns:
        if block.effect.stays:
            places = [(row, before.rows[row].index(block.first)) for row in block.rows]
            out[block.effect.name, block.joint, block.shape] = tuple(
                before.values[log][row][:, place : place + block.count] for row, place in places
            )
    return out


def _values(
    session: Session,
    log: int,
    operation: Operation,
    of_model: list[list[Float[Array, " n"]]],
    term_columns: tuple[TermColumns, ...],
    kept: dict[ColumnKey, tuple[Float[Array, "n c"], ...]],
) -> tuple[Float[Array, "n k"], ...]:
    """In-band columns of one log row by row; the columns ``kept`` of an earlier fit are reused."""
    operation = operation.short_lived_copy()

    def computed(block: TermColumns) -> tuple[Array, ...]:
        known = kept.get((block.effect.name, block.joint, block.shape))
        return effect_columns(session, log, operation, block, session.cutoff_hz) if known is None else known

    rows = [list(columns) for columns in of_model]
    for block, parts in zip(term_columns, in_two_threads(computed, term_columns), strict=True):
        for row, columns in zip(block.rows, parts, strict=True):
            rows[row].extend(columns.T)
    return tuple(np.column_stack(columns) for columns in rows)
