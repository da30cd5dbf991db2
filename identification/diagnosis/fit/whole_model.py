"""The nonlinear model with all its parameters: its torque and its Jacobian at a parameter vector.

The first parameters are changes of the given model within its tolerances. The others belong to terms. A term is one
effect on one joint. Its torque is a sum of columns times coefficients. Its shape is the set of parameters in which the
columns are not linear, such as a delay. A row is one joint's torque. All torques are filtered to the judged band, the
band of low frequencies in which the model is compared with the recordings.

`lay_out` gives the position of each parameter in the vector, and `linearised` gives torque and Jacobian of every
recording. `full_fit` uses both in its Gauss-Newton steps.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from identification.diagnosis.columns.operations import adjusted_robot, operation_of_model
from identification.diagnosis.columns.terms import Term
from identification.diagnosis.fit.fitting import Fitted
from identification.diagnosis.fit.point_mass import load_jacobian
from identification.diagnosis.fit.problem import Problem
from phantom_dyn.array_types import Array, Float
from phantom_dyn.effects.effect import Effect
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.rival import Shape

# Relative step of finite differences. The torque of laws with memory (bristles, backlash) jumps if a parameter changes.
# A much smaller step would give the slope of single jumps, a much larger one would average over the curvature.
_STEP = 0.03


@dataclass(frozen=True)
class TermSlices:
    """Slices of one term's parameters in the parameter vector.

    Attributes:
        term: The effect with the shape that the search has found.
        coefficients: Positions of the coefficients of its columns; for a payload, of mass and first moments alone.
        shape: Positions of its free shape parameters; empty if there are none, or if the coefficients determine them.
    """

    term: Term
    coefficients: slice
    shape: slice

    @property
    def count(self) -> int:
        """Number of coefficients."""
        return self.coefficients.stop - self.coefficients.start

    @property
    def indices(self) -> list[int]:
        """Indices of the coefficients and shape parameters."""
        return list(range(self.coefficients.start, self.shape.stop))


@dataclass(frozen=True)
class ModelLayout:
    """The terms of a nonlinear model and the positions of their parameters in the parameter vector.

    Attributes:
        problem: Columns of the recordings in the judged band, their priors and bounds.
        operations: Motions of the logs with the torque of the given model, or of the model adjusted within its
            tolerances.
        term_slices: Slices of each term's parameters.
        size: Number of parameters; the first are the tolerance parameters.
    """

    problem: Problem
    operations: tuple[Operation, ...]
    term_slices: tuple[TermSlices, ...]
    size: int

    def operation_of(self, slices: TermSlices, log: int) -> Operation:
        """Motion of one log with the model's torque, from which a term's columns are computed.

        If an effect displaces the links, the columns of the tolerance parameters are computed at the true positions of
        the links. So the columns of that effect itself are computed from the given model, not from the adjusted one.
        """
        columns = self.problem.columns
        of_given_model = slices.term.effect_joint in columns.displaced
        return (columns.operations if of_given_model else self.operations)[log]

    @property
    def depends_on_model(self) -> bool:
        """True if the columns of any term depend on the torque of the model."""
        return any(slices.term.effect.follows_model for slices in self.term_slices)

    def adjusted(self, changes: Float[Array, " n"]) -> ModelLayout:
        """The same layout with columns computed from the model after these changes within its tolerances."""
        given = self.problem.session.robot
        robots = {id(given): adjusted_robot(given, changes)}
        operations = []
        for operation in self.problem.columns.operations:
            # A recording with a known load has a model of its own, with the same changes.
            loaded = operation.robot
            if id(loaded) not in robots:
                robots[id(loaded)] = adjusted_robot(loaded, changes, given)
            operations.append(operation_of_model(operation, robots[id(loaded)]))
        return replace(self, operations=tuple(operations))


def lay_out(problem: Problem, terms: tuple[Term, ...], found: Fitted) -> tuple[ModelLayout, Float[Array, " p"]]:
    """Layout of the parameter vector, and its values in a fit."""
    x, term_slices = found.theta[: problem.nuisance_count], []
    for term in terms:
        own = found.theta[list(term.columns[:4] if term.effect.inertial == "point mass" else term.columns)]
        fixed = term.effect.shape_is_estimate or term.effect.shape_held
        shape = np.array(() if fixed else term.shape, dtype=float)
        middle, stop = len(x) + len(own), len(x) + len(own) + len(shape)
        term_slices.append(TermSlices(term, slice(len(x), middle), slice(middle, stop)))
        x = np.concatenate([x, own, shape])
    return ModelLayout(problem, problem.columns.operations, tuple(term_slices), len(x)), x


@dataclass(frozen=True)
class Linearised:
    """First-order expansion of a model, for each log.

    Attributes:
        torque: Torque minus that of the given model [N m or N], ``(n, nv)`` each.
        slopes: Jacobian of this torque, ``(n, nv, p)`` each.
    """

    torque: tuple[Float[Array, "_ nv"], ...]
    slopes: tuple[Float[Array, "_ nv p"], ...]


def linearised(layout: ModelLayout, x: Float[Array, " p"]) -> Linearised:
    """Expand the model to first order about a parameter vector."""
    return Linearised(*zip(*(_linearised_log(layout, x, log) for log in range(len(layout.operations))), strict=True))


def weighted_products(
    layout: ModelLayout, model: Linearised, residual: tuple[Float[Array, "_ nv"], ...] | None = None
) -> tuple[Array, Array, Array]:
    """Weighted products of slopes and a residual for each training block.

    Args:
        layout: The terms of the model.
        model: The model, expanded to first order.
        residual: A torque for each log ``(n, nv)``; None to use the residual of the model.

    Returns:
        Slopes times slopes, slopes times residual, and residual times residual, ``(B, p, p)``, ``(B, p)`` and ``(B,)``.
    """
    if residual is None:
        residual = tuple(
            before - torque for before, torque in zip(layout.problem.white.residual, model.torque, strict=True)
        )
    problem = layout.problem
    a, b, c = [], [], []
    for block, fold in zip(problem.blocks, problem.grams.fold, strict=True):
        if fold < 0:
            continue
        part = slice(block.start, block.stop)
        scale = problem.weights.scale(block.log, part) * problem.white.usable[block.log][part]
        slopes = (model.slopes[block.log][part] * scale[:, :, None]).reshape(-1, layout.size)
        weighted = (residual[block.log][part] * scale).ravel()
        a.append(slopes.T @ slopes)
        b.append(slopes.T @ weighted)
        c.append(weighted @ weighted)
    return np.array(a), np.array(b), np.array(c)


def torque_change(
    layout: ModelLayout, adjusted: ModelLayout, x: Float[Array, " p"]
) -> tuple[Float[Array, "_ nv"], ...]:
    """Change of the terms' torque if their columns come from ``adjusted``, not ``layout``, for each log ``(n, nv)``."""
    out = tuple(np.zeros_like(residual) for residual in layout.problem.white.residual)
    for slices in layout.term_slices:
        if slices.term.effect.follows_model:
            torques = zip(term_torque(adjusted, slices, x), term_torque(layout, slices, x), strict=True)
            for change, (new, old) in zip(out, torques, strict=True):
                change += new - old
    return out


def term_torque(layout: ModelLayout, slices: TermSlices, x: Float[Array, " p"]) -> tuple[Float[Array, "_ nv"], ...]:
    """Torque of one term in the judged band [N m or N], for each log ``(n, nv)``."""
    return tuple(
        _torque_at(layout, slices, x[slices.coefficients], x[slices.shape], log)
        for log in range(len(layout.operations))
    )


def _linearised_log(
    layout: ModelLayout, x: Float[Array, " p"], log: int
) -> tuple[Float[Array, "_ nv"], Float[Array, "n nv p"]]:
    """Torque of one log minus that of the given model, and its Jacobian."""
    problem = layout.problem
    nuisances = np.arange(problem.nuisance_count)
    n, nv = problem.white.residual[log].shape
    slopes = np.zeros((n, nv, layout.size))
    slopes[:, :, nuisances] = columns_of(problem, tuple(nuisances.tolist()), log)
    torque = slopes[:, :, nuisances] @ x[nuisances]
    torque_constants = [slices for slices in layout.term_slices if slices.term.effect.scales_joint]
    for slices in layout.term_slices:
        if slices not in torque_constants:
            at = slices.indices
            own, slopes[:, :, at] = _with_slopes(layout, slices, x[slices.coefficients], x[slices.shape], log)
            torque += own
    for slices in torque_constants:
        # A wrong torque constant multiplies the whole torque of its row, other terms included, by one plus its
        # coefficient.
        column = columns_of(problem, slices.term.columns, log)[:, :, 0]
        rows = np.any(column != 0, axis=0)
        error = x[slices.coefficients][0]
        slopes[:, rows] *= 1.0 + error
        slopes[:, rows, slices.coefficients.start] = column[:, rows] + torque[:, rows]
        torque[:, rows] += error * (column[:, rows] + torque[:, rows])
    return torque, slopes


def _with_slopes(
    layout: ModelLayout, slices: TermSlices, own: Float[Array, " k"], shape: Float[Array, " m"], log: int
) -> tuple[Float[Array, "_ nv"], Float[Array, "n nv p"]]:
    """Torque of one term, and its Jacobian with respect to coefficients and shape."""
    effect = slices.term.effect
    if effect.inertial == "point mass":
        columns = columns_of(layout.problem, slices.term.columns, log)
        slopes = columns @ load_jacobian(layout.problem.session.robot, slices.term, own)
        # The torque is homogeneous of degree one in mass and first moments, so it is the slopes times these four.
        return slopes @ own, slopes

    def slope(k: int) -> Float[Array, "n nv"]:
        return central_difference(lambda own, shape: _torque_at(layout, slices, own, shape, log), own, shape, k)

    if effect.shape_is_estimate or effect.first_order:
        # These laws are not linear in their coefficients, so their columns are not the derivatives.
        return _torque_at(layout, slices, own, shape, log), np.stack([slope(k) for k in range(len(own))], axis=-1)
    columns = _columns_at_shape(layout, slices, tuple(shape.tolist()) or slices.term.shape, log)
    of_shape = [slope(len(own) + k)[:, :, None] for k in range(len(shape))]
    return columns @ own, np.concatenate([columns, *of_shape], axis=2)


def central_difference(
    torque: Callable[[Float[Array, " k"], Float[Array, " m"]], Float[Array, "n nv"]],
    own: Float[Array, " k"],
    shape: Float[Array, " m"],
    k: int,
) -> Float[Array, "n nv"]:
    """Derivative of a term's torque with respect to its coefficient or shape parameter ``k``, shape parameters last."""
    numbers = np.concatenate([own, shape])
    # The step of a coefficient is relative to the largest one, as some may be zero; that of a shape to its own value.
    scaled_by = own if k < len(own) else numbers[k : k + 1]
    step = np.zeros(len(numbers))
    step[k] = _STEP * max(float(np.abs(scaled_by).max()), 1e-9)
    above, below = (torque(at[: len(own)], at[len(own) :]) for at in (numbers + step, numbers - step))
    return (above - below) / (2.0 * step[k])


def _torque_at(
    layout: ModelLayout, slices: TermSlices, own: Float[Array, " k"], shape: Float[Array, " m"], log: int
) -> Float[Array, "n nv"]:
    """Torque of one term, in the judged band."""
    term = slices.term
    if isinstance(term.effect, Effect) and term.effect.first_order:
        # The columns are a first-order expansion, so the law itself is evaluated. It gives the torque on the joint; the
        # additional torque of the drive has the opposite sign.
        operation = layout.operation_of(slices, log)
        theta = term.effect.from_coefficients(operation.robot, term.joint, own, ())
        torque = -term.effect.torque(operation.robot, operation, term.joint, theta)
        return in_band(layout, log, torque)
    at = tuple(shape.tolist()) or term.shape
    if term.effect.shape_is_estimate:
        # The coefficients of this law determine its shape, so the torque is exact if both agree.
        at = term.effect.at_estimate(own, term.shape)
    return _columns_at_shape(layout, slices, at, log) @ own


def columns_of(problem: Problem, wanted: tuple[int, ...], log: int) -> Float[Array, "n nv k"]:
    """Wanted columns of the problem in the judged band, zero on rows that do not contain them."""
    white = problem.white
    out = np.zeros((*white.residual[log].shape, len(wanted)))
    for j, index in enumerate(white.rows):
        position = {column: k for k, column in enumerate(index)}
        contained = [k for k, column in enumerate(wanted) if column in position]
        out[:, j, contained] = white.values[log][j][:, [position[wanted[k]] for k in contained]]
    return out


def _columns_at_shape(layout: ModelLayout, slices: TermSlices, shape: Shape, log: int) -> Float[Array, "n nv k"]:
    """Columns of an effect at a shape, in the judged band."""
    term = slices.term
    # The columns of the problem hold for the shape of the search and the given model. Columns of accelerations have had
    # an additional low pass there.
    if shape == term.shape and not (term.effect.uses_acceleration or term.effect.follows_model):
        return columns_of(layout.problem, term.columns, log)
    operation = layout.operation_of(slices, log)
    signature = term.effect.signature(operation.robot, operation, term.joint, shape)
    on_its_rows = in_band(layout, log, signature.columns)
    out = np.zeros((len(on_its_rows), layout.problem.session.robot.nv, on_its_rows.shape[2]))
    out[:, list(signature.rows)] = on_its_rows
    return out


def in_band(layout: ModelLayout, log: int, x: Float[Array, "N ..."]) -> Float[Array, "n ..."]:
    """A series at the full rate, filtered to the judged band like the recorded torque."""
    session = layout.problem.session
    return session.log_in_judged_band(session.logs[log].band(x), log)
