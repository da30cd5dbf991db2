"""Probability that a planned recording separates the rival explanations of a finding (T-optimal design).

If one of two explanations is true, the other one is fitted to its torque. The squared distance of the two is the sum of
squares of the residual, in units of the noise. The planned recording increases the loss of the wrong explanation by
this distance. From this increase follows the probability that the diagnosis no longer lists the wrong explanation.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np

from identification.diagnosis import decision_rules as rules
from identification.diagnosis.result import EffectAt
from identification.diagnosis.search.search import Search
from identification.engine import contract_levels
from identification.engine.numerics.bounded import bounded_solve
from identification.engine.products.blocks import held_out_share
from identification.next_experiment.hypotheses import Hypothesis, Model, model_of, union_of
from phantom_dyn.array_types import Array, Float, Int
from phantom_dyn.random_streams import random_stream

# Number of random models that are drawn from the uncertainty of the fit, in addition to the fit itself.
_DRAWS = 7
# A wrong explanation may have a lower loss in the existing recordings than the true one. At most this difference counts
# [squared standard deviations]: a larger one means that shapes of the wrong laws have fitted noise.
_AHEAD = 8.0


Effects = tuple[EffectAt, ...]
"""Effects of one explanation."""


@dataclass(frozen=True)
class Pair:
    """Two explanations of the same finding."""

    one: Hypothesis
    other: Hypothesis


@dataclass(frozen=True)
class Rivalry:
    """The explanations of one finding, as pairs to be separated, with their fits to the existing recordings.

    Here and below ``u`` is the number of columns that all explanations use together.

    Attributes:
        pairs: Pairs of explanations.
        models: Fits of each explanation with different shapes, the best first, by its effects.
        recorded: Weighted products of the columns over the existing recordings, ``(u, u)``.
        held_out: Share of the samples on which held-out losses are computed.
        nuisance_count: Number of tolerance parameters; their columns come first.
    """

    pairs: tuple[Pair, ...]
    models: dict[Effects, tuple[Model, ...]]
    recorded: Float[Array, "u u"]
    held_out: float
    nuisance_count: int

    @cached_property
    def possible_models(self) -> dict[tuple[Effects, Effects], _PossibleModels]:
        """Models that may be true according to the recordings, by the true and the wrong explanation of a pair.

        They are drawn once and used for all planned motions, so that chance does not change the order of the motions.
        """
        rng = random_stream("models that recordings leave possible")
        out: dict[tuple[Effects, Effects], _PossibleModels] = {}
        for pair in self.pairs:
            for truth, wrong in ((pair.one, pair.other), (pair.other, pair.one)):
                model = self.models[truth.effects][0]
                normals = rng.normal(size=(_DRAWS, model.basis.shape[1]))
                coefficients = draws_of(model, self.recorded, normals)
                wrong_models = self.models[wrong.effects]
                before = tuple(self.held_out_loss(coefficients, other, self.recorded) for other in wrong_models)
                out[truth.effects, wrong.effects] = _PossibleModels(coefficients, before)
        return out

    def held_out_loss(
        self, coefficients: Float[Array, "d u"], wrong: Model, products: Float[Array, "u u"]
    ) -> Float[Array, " d"]:
        """Expected held-out loss of a wrong model, beyond noise, for each row of true coefficients, ``(d,)``."""
        return self.held_out * distance(coefficients, self.nuisance_count, wrong, products)


@dataclass(frozen=True)
class _PossibleModels:
    """Models of a true explanation that are possible according to the recordings.

    Attributes:
        coefficients: Coefficients of each possible model, ``(d, u)``.
        before: For each model of the wrong explanation, its expected held-out loss in the existing recordings if each
            possible model is true, ``(d,)``.
    """

    coefficients: Float[Array, "d u"]
    before: tuple[Float[Array, " d"], ...]


def rivalry_of(search: Search, groups: tuple[tuple[Hypothesis, ...], ...]) -> tuple[Rivalry, ...]:
    """One rivalry for each group of explanations; all use the union of the columns of all groups."""
    union = union_of(tuple(one for group in groups for one in group))
    return tuple(_rivalry(search, group, union) for group in groups)


@dataclass(frozen=True)
class Separation:
    """Expected separation of the explanations of one finding by a planned recording.

    Attributes:
        power: Probability that each pair is separated, averaged over the two cases that one or the other is true.
        gain: Squared distance of each pair by the planned recording.
        resolved: Probability that the rival that is hardest to rule out is ruled out, averaged over the explanations
            that may be true.
    """

    power: Float[Array, " p"]
    gain: Float[Array, " p"]
    resolved: float


def separation(rivalry: Rivalry, planned: Float[Array, "u u"]) -> Separation:
    """Expected separation of the explanations of one finding by a planned recording.

    Args:
        rivalry: Pairs of explanations with their fits.
        planned: Weighted products of the columns over the planned recording, ``(u, u)``.
    """
    all_products = rivalry.recorded + planned
    pair_powers, pair_distances = [], []
    least_power: dict[Effects, float] = {}  # by the true explanation
    probability: dict[Effects, float] = {}
    for pair in rivalry.pairs:
        powers, distances, weights = [], [], []
        for truth, wrong in ((pair.one, pair.other), (pair.other, pair.one)):
            if wrong.contains(truth):
                # A richer law fits the torque of its special case, so their distance says nothing.
                power = _power_against_richer(rivalry, truth, wrong, all_products)
            else:
                power, gain = _power_and_distance(rivalry, truth, wrong, all_products)
                distances.append(gain)
            powers.append(power)
            weights.append(max(truth.probability, 1e-3))
            least_power[truth.effects] = min(least_power.get(truth.effects, 1.0), power)
            probability[truth.effects] = weights[-1]
        pair_powers.append(float(np.average(powers, weights=weights)))
        pair_distances.append(min(distances, default=0.0))
    resolved = float(np.average(list(least_power.values()), weights=list(probability.values())))
    return Separation(np.array(pair_powers), np.array(pair_distances), resolved)


def _power_and_distance(
    rivalry: Rivalry,
    truth: Hypothesis,
    wrong: Hypothesis,
    all_products: Float[Array, "u u"],
) -> tuple[float, float]:
    """Mean probability that the wrong explanation is ruled out, and median distance, over the possible models.

    All shapes of the wrong explanation have to be ruled out, so that the shape with the least probability counts.
    """
    model, possible_models = rivalry.models[truth.effects][0], rivalry.possible_models[truth.effects, wrong.effects]
    count = len(possible_models.coefficients)
    power, gain = np.full(count, np.inf), np.full(count, np.inf)
    for other, before in zip(rivalry.models[wrong.effects], possible_models.before, strict=True):
        after = rivalry.held_out_loss(possible_models.coefficients, other, all_products)
        increase = np.maximum(after - before, 0.0)
        head_start = float(np.clip(other.score - model.score, -_AHEAD, 0.0))
        power = np.minimum(power, power_of(increase, head_start, before))
        gain = np.minimum(gain, increase)
    return float(power.mean()), float(np.median(gain))


def _power_against_richer(
    rivalry: Rivalry,
    truth: Hypothesis,
    wrong: Hypothesis,
    all_products: Float[Array, "u u"],
) -> float:
    """Mean probability that a richer law is ruled out if the simpler law, its special case, is true.

    All shapes of the richer law have to be ruled out. There are two ways, of which the more probable one counts: the
    additional part of the richer law would have been seen, or the shape fits too badly. The latter is possible because
    some laws equal the simpler law only at the limit of their shapes.
    """
    model, possible_models = rivalry.models[truth.effects][0], rivalry.possible_models[truth.effects, wrong.effects]
    power = np.full(len(possible_models.coefficients), np.inf)
    for rich, before in zip(rivalry.models[wrong.effects], possible_models.before, strict=True):
        after = rivalry.held_out_loss(possible_models.coefficients, rich, all_products)
        lead = max(rich.score - model.score, -_AHEAD)
        by_bad_fit = power_of_hopeless(np.maximum(after - before, 0.0), lead, after)
        by_unseen_part = power_of_simpler(model, rich, all_products, rivalry.recorded)
        power = np.minimum(power, np.maximum(by_bad_fit, by_unseen_part))
    return float(power.mean())


def _rivalry(search: Search, group: tuple[Hypothesis, ...], union: Int[Array, " u"]) -> Rivalry:
    """All pairs of the explanations of one finding, with their models in the columns of the union."""
    pairs = tuple(Pair(one, other) for one, other in combinations(group, 2))
    models = {one.effects: tuple(model_of(variant, union) for variant in one.variants) for one in group}
    recorded = search.problem.total_a[np.ix_(union, union)]
    return Rivalry(pairs, models, recorded, held_out_share(search.problem.blocks), search.problem.nuisance_count)


def draws_of(model: Model, products: Float[Array, "u u"], normals: Float[Array, "d n"]) -> Float[Array, "e u"]:
    """Coefficients that are possible according to the recordings: those of the fit, then random ones, ``(d + 1, u)``.

    Args:
        model: The fitted model.
        products: Weighted products of all columns over the recordings, ``(u, u)``.
        normals: Standard normal numbers, one row per random model, ``(d, n)``.
    """
    information = model.basis.T @ products @ model.basis
    effect_prior = np.where(model.is_nuisance, 0.0, _prior_of_effects(model, products))
    precision = _solvable(information + np.diag(model.prior + effect_prior))
    # With the Cholesky factor R of the precision, P = R^T R, the vector R^-1 z has the covariance P^-1.
    upper = np.linalg.cholesky(precision).T
    deviations = np.linalg.solve(upper, normals.T).T
    y = np.concatenate([model.y[None], np.clip(model.y + deviations, model.lower, model.upper)])
    return y @ model.basis.T + model.shift


def distance(
    truth: Float[Array, "d u"], nuisance_count: int, model: Model, products: Float[Array, "u u"]
) -> Float[Array, " d"]:
    """Squared distance of a wrong model from true models: least cost of a fit to the torque of each, ``(d,)``.

    The cost is the weighted sum of squared residuals, plus the cost of the fitted tolerance parameters minus that of
    the true ones. It is at least zero.

    Args:
        truth: True coefficients, one row for each true model, ``(d, u)``; tolerance parameters first.
        nuisance_count: Number of tolerance parameters.
        model: The model that is fitted.
        products: Weighted products of all columns over all recordings, ``(u, u)``.
    """
    information = _solvable(model.basis.T @ products @ model.basis + np.diag(model.prior))
    difference = truth - model.shift
    right_side = (model.basis.T @ products @ difference.T).T
    y = np.linalg.solve(information, right_side.T).T
    # If a parameter violates its bounds, the fit is repeated within the bounds.
    for row in np.flatnonzero(((y < model.lower) | (y > model.upper)).any(axis=1)):
        y[row] = bounded_solve(information, right_side[row], model.lower, model.upper)
    residual = difference - y @ model.basis.T
    nuisance_prior = np.where(model.is_nuisance, model.prior, 0.0)
    prior_of_truth = np.zeros(len(model.shift))
    prior_of_truth[:nuisance_count] = nuisance_prior[model.is_nuisance]
    squares = np.sum((residual @ products) * residual, axis=1)
    return np.maximum(squares + y**2 @ nuisance_prior - truth**2 @ prior_of_truth, 0.0)


def power_of(gain: Float[Array, " d"], head_start: float, before: Float[Array, " d"]) -> Float[Array, " d"]:
    """Probability that a wrong model wins so few bootstrap replicates that it is no longer listed as a rival.

    The difference of the held-out losses of both models has the expectation ``gain`` and the variance ``4 gain`` of a
    noncentral chi-squared distribution. Over bootstrap replicates, which draw from all recordings, its variance is
    ``4 (gain + before)``.

    Args:
        gain: Expected increase of the wrong model's held-out loss by the planned recording, ``(d,)``.
        head_start: Loss of the wrong model minus loss of the true one in the existing recordings; zero or negative.
        before: Expected held-out loss of the wrong model in the existing recordings, ``(d,)``.
    """
    from scipy.special import ndtr, ndtri

    deviation = 2.0 * np.sqrt(np.maximum(gain, 1e-12))
    deviation_of_replicates = 2.0 * np.sqrt(np.maximum(gain + before, 1e-12))
    return ndtr((gain + head_start + ndtri(contract_levels.LISTED) * deviation_of_replicates) / deviation)


def power_of_hopeless(gain: Float[Array, " d"], lead: float, after: Float[Array, " d"]) -> Float[Array, " d"]:
    """Probability that a wrong model fits so badly that the diagnosis no longer compares it with the true one.

    Args:
        gain: Expected increase of the wrong model's held-out loss by the planned recording, ``(d,)``.
        lead: Loss and price of the wrong model minus those of the true one in the existing recordings.
        after: Expected held-out loss of the wrong model in all recordings, including the planned one, ``(d,)``.
    """
    from scipy.special import ndtr

    # The standard error of the loss over blocks is that of a noncentral chi-squared variable, twice the root of it.
    bar = rules.HOPELESS_ERRORS * 2.0 * np.sqrt(np.maximum(after, 0.0)) + rules.HOPELESS_BEYOND
    return ndtr((gain + lead - bar) / (2.0 * np.sqrt(np.maximum(gain, 1e-12))))


def power_of_simpler(simple: Model, rich: Model, products: Float[Array, "u u"], recorded: Float[Array, "u u"]) -> float:
    """Probability that a richer law is ruled out if the simpler law that it contains is true.

    The diagnosis lists the richer law as long as its additional part may exist without being seen: see
    `odds_of_richer_laws` in `identification.diagnosis.search.richer_laws`. A part of ordinary size makes
    `EXPECTED_SHARE` of the torque of the finding.

    Args:
        simple: The model that is true.
        rich: The model that contains the simpler one.
        products: Weighted products of all columns over all recordings, including the planned one, ``(u, u)``.
        recorded: Weighted products of all columns over the existing recordings, ``(u, u)``.
    """
    from scipy.special import gammainc

    additional = [k for k in rich.columns if k not in simple.columns]
    replaced = [k for k in simple.columns if k not in rich.columns]
    if not additional:
        return 0.0
    column_squares = np.diag(recorded)[additional]
    torque_squares = float(simple.theta[replaced] @ recorded[np.ix_(replaced, replaced)] @ simple.theta[replaced])
    if torque_squares <= 0 or not (column_squares > 0).all():
        return 0.0
    # Information on the additional columns if the simple model is fitted too, in units of their ordinary size.
    fitted = _solvable(simple.basis.T @ products @ simple.basis + np.diag(simple.prior))
    cross = simple.basis.T @ products[:, additional]
    information = products[np.ix_(additional, additional)] - cross.T @ np.linalg.solve(fitted, cross)
    size = rules.EXPECTED_SHARE * np.sqrt(torque_squares / column_squares)
    values = np.maximum(np.linalg.eigvalsh(information * np.outer(size, size)), 0.0)
    limit = np.log1p(values).sum() + 2.0 * np.log(contract_levels.LISTED / (1.0 - contract_levels.LISTED))
    return float(gammainc(len(additional) / 2.0, max(limit, 0.0) / 2.0))


def _prior_of_effects(model: Model, products: Float[Array, "u u"]) -> Float[Array, " n"]:
    """Prior precision of each effect parameter about the fit, ``(n,)``.

    A deviation by one standard deviation changes the torque by `EXPECTED_SHARE` of the torque of all effects.
    """
    columns = list(model.columns)
    theta = model.theta[columns]
    # The torque of all effects together counts as at least one standard deviation of the noise.
    torque_squares = max(float(theta @ products[np.ix_(columns, columns)] @ theta), 1.0)
    squares_per_parameter = np.sum(model.basis * (products @ model.basis), axis=0)
    return squares_per_parameter / (rules.EXPECTED_SHARE**2 * torque_squares)


def _solvable(a: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """The matrix with a small ridge on its diagonal, so that it is regular if no data determine a parameter."""
    return a + np.diag(1e-9 * np.diag(a) + 1e-12 * max(float(np.trace(a)) / max(len(a), 1), 1e-300))
