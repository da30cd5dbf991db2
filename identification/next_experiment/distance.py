"""Distance of rivals on a new recording (T-optimality): the residual of one fitted to the torque of the other."""

from __future__ import annotations

import numpy as np

from identification.diagnosis import decision_rules as rules
from identification.engine import contract_levels
from identification.engine.numerics.bounded import bounded_solve
from identification.next_experiment.hypotheses import Model
from phantom_dyn.array_types import Array, Float


def draws_of(model: Model, products: Float[Array, "u u"], normals: Float[Array, "d n"]) -> Float[Array, "e u"]:
    """Coefficients that the recordings leave possible if the model is true: the fit itself, then one per draw.

    Args:
        model: The fitted model.
        products: Of all columns in the recordings, weighted.
        normals: Standard normal numbers, ``(d, n)``, one row a draw.
    """
    inner = model.basis.T @ products @ model.basis
    width = np.where(model.moves, 0.0, _per_size(model, products))
    precise = _solvable(inner + np.diag(model.prior + width))
    # Of the Cholesky factor R of the precision, R^-1 z has the covariance wanted.
    upper = np.linalg.cholesky(precise).T
    steps = np.linalg.solve(upper, normals.T).T
    y = np.concatenate([model.y[None], np.clip(model.y + steps, model.lower, model.upper)])
    return y @ model.basis.T + model.shift


def distance(truth: Float[Array, "d u"], moves: int, model: Model, products: Float[Array, "u u"]) -> Float[Array, " d"]:
    """Least weighted squared residual of a model fitted to the torque of others, with the extra cost of its moves.

    Args:
        truth: Coefficients that are true, one row each; the first ``moves`` are moves within the tolerances.
        moves: How many.
        model: Fits them.
        products: Of all columns, over everything that is recorded.
    """
    inner = _solvable(model.basis.T @ products @ model.basis + np.diag(model.prior))
    apart = truth - model.shift
    wanted = (model.basis.T @ products @ apart.T).T
    y = np.linalg.solve(inner, wanted.T).T
    # A tolerance ends at its bounds.
    for row in np.flatnonzero(((y < model.lower) | (y > model.upper)).any(axis=1)):
        y[row] = bounded_solve(inner, wanted[row], model.lower, model.upper)
    residual = apart - y @ model.basis.T
    own = np.where(model.moves, model.prior, 0.0)
    theirs = np.zeros(len(model.shift))
    theirs[:moves] = own[model.moves]
    left = np.sum((residual @ products) * residual, axis=1)
    return np.maximum(left + y**2 @ own - truth**2 @ theirs, 0.0)


def power_of(gain: Float[Array, " d"], head_start: float, before: Float[Array, " d"]) -> Float[Array, " d"]:
    """Probability that a wrong model wins so few bootstrap replicates that it is no longer listed.

    The held-out loss of the wrong model differs by the gain with the variance of a noncentral chi-squared, ``4 gain``,
    and from replicate to replicate by as much again, of everything that is recorded.

    Args:
        gain: Expected further held-out loss of the wrong model.
        head_start: What the wrong model has lost so far, negative if it is ahead.
        before: Expected held-out loss of the wrong model in what is recorded now.
    """
    from scipy.special import ndtr, ndtri

    spread = 2.0 * np.sqrt(np.maximum(gain, 1e-12))
    replicates = 2.0 * np.sqrt(np.maximum(gain + before, 1e-12))
    return ndtr((gain + head_start + ndtri(contract_levels.LISTED) * replicates) / spread)


def power_of_hopeless(gain: Float[Array, " d"], lead: float, after: Float[Array, " d"]) -> Float[Array, " d"]:
    """Probability that a model loses so much, block by block, that it is no longer compared with what is true.

    Args:
        gain: Expected further held-out loss of the wrong model.
        lead: What the wrong model has lost so far, its price included; negative if it is ahead.
        after: Expected held-out loss of the wrong model in everything that is recorded then.
    """
    from scipy.special import ndtr

    # The loss scatters from block to block as a noncentral chi-squared does.
    bar = rules.HOPELESS_ERRORS * 2.0 * np.sqrt(np.maximum(after, 0.0)) + rules.HOPELESS_BEYOND
    return ndtr((gain + lead - bar) / (2.0 * np.sqrt(np.maximum(gain, 1e-12))))


def power_of_simpler(simple: Model, rich: Model, products: Float[Array, "u u"], recorded: Float[Array, "u u"]) -> float:
    """Probability that a richer law is struck off if the simpler one that it contains is true.

    The richer one is kept as long as what it has more may be there and not be seen; see `odds_of_richer`.

    Args:
        simple: The model that is true.
        rich: The one that contains it.
        products: Of all columns, over everything that is recorded then.
        recorded: Over what is recorded now.
    """
    from scipy.special import gammainc

    more = [k for k in rich.columns if k not in simple.columns]
    gone = [k for k in simple.columns if k not in rich.columns]
    if not more:
        return 0.0
    own = np.diag(recorded)[more]
    energy = float(simple.theta[gone] @ recorded[np.ix_(gone, gone)] @ simple.theta[gone])
    if energy <= 0 or not (own > 0).all():
        return 0.0
    inner = _solvable(simple.basis.T @ products @ simple.basis + np.diag(simple.prior))
    made = simple.basis.T @ products[:, more]
    shown = products[np.ix_(more, more)] - made.T @ np.linalg.solve(inner, made)
    size = rules.EXPECTED_SHARE * np.sqrt(energy / own)
    values = np.maximum(np.linalg.eigvalsh(shown * np.outer(size, size)), 0.0)
    room = np.log1p(values).sum() + 2.0 * np.log(contract_levels.LISTED / (1.0 - contract_levels.LISTED))
    return float(gammainc(len(more) / 2.0, max(room, 0.0) / 2.0))


def _per_size(model: Model, products: Float[Array, "u u"]) -> Float[Array, " n"]:
    """Precision about the fit of each number of the effects: a part of the torque that they carry together."""
    columns = list(model.columns)
    theta = model.theta[columns]
    # No less than what a single standard deviation carries.
    energy = max(float(theta @ products[np.ix_(columns, columns)] @ theta), 1.0)
    own = np.sum(model.basis * (products @ model.basis), axis=0)
    return own / (rules.EXPECTED_SHARE**2 * energy)


def _solvable(a: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """The matrix with a hair on its diagonal, so that what no data show does not stop a solver."""
    return a + np.diag(1e-9 * np.diag(a) + 1e-12 * max(float(np.trace(a)) / max(len(a), 1), 1e-300))
