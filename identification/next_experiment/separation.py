"""Probability that a planned recording separates rivals, and the squared distance between their torques (T-optimality).

The distance of two rivals is the residual of one rival after a fit to the torque of the other.
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

# Number of random models within the uncertainty of the fit, in addition to the fit itself.
_DRAWS = 7
# If a rival's in-sample loss is lower than that of the true explanation, at most this difference counts, in squared
# standard deviations: a larger difference means that the rival's shapes have fitted noise.
_AHEAD = 8.0


@dataclass(frozen=True)
class Pair:
    """Two explanations of the same finding."""

    one: Hypothesis
    other: Hypothesis


@dataclass(frozen=True)
class Rivalry:
    """Pairs of rivals with their fits, from which the power of a recording to separate them is computed.

    Attributes:
        pairs: Pairs to be separated.
        models: Fits of each explanation, by its effects.
        recorded: Products of the columns over the existing recordings.
        held_out: Share of the samples on which held-out losses are computed.
        nuisance_count: Number of tolerance parameters, whose columns come first.
    """

    pairs: tuple[Pair, ...]
    models: dict[tuple[EffectAt, ...], tuple[Model, ...]]
    recorded: Float[Array, "u u"]
    held_out: float
    nuisance_count: int

    @cached_property
    def possible_models(self) -> dict[tuple[EffectAt, ...], dict[tuple[EffectAt, ...], _PossibleModels]]:
        """Models that are possible according to the recordings, by the true and the wrong explanation of a pair.

        The same random models are used for every planned motion, so that they do not
        change the order of the motions.
        """
        rng = random_stream("models that recordings leave possible")
        out: dict[tuple[EffectAt, ...], dict[tuple[EffectAt, ...], _PossibleModels]] = {}
        for pair in self.pairs:
            for truth, wrong in ((pair.one, pair.other), (pair.other, pair.one)):
                model = self.models[truth.effects][0]
                normals = rng.normal(size=(_DRAWS, model.basis.shape[1]))
                coefficients = draws_of(model, self.recorded, normals)
                before = tuple(
                    self.held_out_loss(coefficients, other, self.recorded) for other in self.models[wrong.effects]
                )
                out.setdefault(truth.effects, {})[wrong.effects] = _PossibleModels(coefficients, before)
        return out

    def held_out_loss(
        self, coefficients: Float[Array, "d u"], wrong: Model, products: Float[Array, "u u"]
    ) -> Float[Array, " d"]:
        """Expected held-out loss of a wrong model for each row of coefficients that may be true, shape ``(d,)``."""
        return self.held_out * distance(coefficients, self.nuisance_count, wrong, products)


@dataclass(frozen=True)
class _PossibleModels:
    """Models that are possible according to the recordings, if one of two explanations is true.

    Attributes:
        coefficients: Coefficients that may be true, ``(d, u)``.
        before: For each model of the wrong explanation, its expected held-out losses in the existing recordings,
            ``(d,)``.
    """

    coefficients: Float[Array, "d u"]
    before: tuple[Float[Array, " d"], ...]


def rivalry_of(search: Search, groups: tuple[tuple[Hypothesis, ...], ...]) -> tuple[Rivalry, ...]:
    """One rivalry per finding; all use the union of the columns of all findings."""
    union = union_of(tuple(one for group in groups for one in group))
    return tuple(_rivalry(search, group, union) for group in groups)


@dataclass(frozen=True)
class Separation:
    """Expected separation of one finding's rivals by a recording.

    Attributes:
        power: Probability that each pair is separated, averaged over the two cases that one or the other is true.
        gain: Squared distance between the torques of each pair.
        resolved: Probability that the rival that is hardest to separate is ruled out, averaged over the explanations
            that may be true.
    """

    power: Float[Array, " p"]
    gain: Float[Array, " p"]
    resolved: float


def separation(rivalry: Rivalry, planned: Float[Array, "u u"]) -> Separation:
    """Expected separation of one finding's rivals by a planned recording.

    Args:
        rivalry: Pairs of rivals with their fits.
        planned: Products over the planned recording, shape ``(u, u)``.
    """
    all_products = rivalry.recorded + planned
    powers, distances = [], []
    hardest: dict[tuple[EffectAt, ...], float] = {}
    likely: dict[tuple[EffectAt, ...], float] = {}
    for pair in rivalry.pairs:
        shares, gains, weights = [], [], []
        for truth, wrong in ((pair.one, pair.other), (pair.other, pair.one)):
            if wrong.contains(truth):
                shares.append(_power_against_richer(rivalry, truth, wrong, all_products))
            else:
                power, gain = _power_and_distance(rivalry, truth, wrong, all_products)
                shares.append(power)
                gains.append(gain)
            weights.append(max(truth.probability, 1e-3))
            hardest[truth.effects] = min(hardest.get(truth.effects, 1.0), shares[-1])
            likely[truth.effects] = weights[-1]
        powers.append(float(np.average(shares, weights=weights)))
        distances.append(min(gains, default=0.0))
    resolved = float(np.average(list(hardest.values()), weights=list(likely.values())))
    return Separation(np.array(powers), np.array(distances), resolved)


def _power_and_distance(
    rivalry: Rivalry,
    truth: Hypothesis,
    wrong: Hypothesis,
    all_products: Float[Array, "u u"],
) -> tuple[float, float]:
    """Probability that the wrong explanation is ruled out (mean over the possible models), and the median distance."""
    model, possible_models = rivalry.models[truth.effects][0], rivalry.possible_models[truth.effects][wrong.effects]
    count = len(possible_models.coefficients)
    power, gain = np.full(count, np.inf), np.full(count, np.inf)
    for other, before in zip(rivalry.models[wrong.effects], possible_models.before, strict=True):
        more = np.maximum(rivalry.held_out_loss(possible_models.coefficients, other, all_products) - before, 0.0)
        head_start = float(np.clip(other.score - model.score, -_AHEAD, 0.0))
        power = np.minimum(power, power_of(more, head_start, before))
        gain = np.minimum(gain, more)
    return float(power.mean()), float(np.median(gain))


def _power_against_richer(
    rivalry: Rivalry,
    truth: Hypothesis,
    wrong: Hypothesis,
    all_products: Float[Array, "u u"],
) -> float:
    """Mean probability that a richer law is ruled out if the simpler law, its special case, is true.

    The richer law is ruled out if each of its shapes is ruled out. A shape is ruled out if its additional part would
    have been seen. A shape is also ruled out if it fits too badly: a law may equal the simpler one only at the limit of
    its shapes.
    """
    model, possible_models = rivalry.models[truth.effects][0], rivalry.possible_models[truth.effects][wrong.effects]
    power = np.full(len(possible_models.coefficients), np.inf)
    for rich, before in zip(rivalry.models[wrong.effects], possible_models.before, strict=True):
        after = rivalry.held_out_loss(possible_models.coefficients, rich, all_products)
        lead = max(rich.score - model.score, -_AHEAD)
        worse = power_of_hopeless(np.maximum(after - before, 0.0), lead, after)
        unseen = power_of_simpler(model, rich, all_products, rivalry.recorded)
        power = np.minimum(power, np.maximum(worse, unseen))
    return float(power.mean())


def _rivalry(search: Search, group: tuple[Hypothesis, ...], union: Int[Array, " u"]) -> Rivalry:
    pairs = tuple(Pair(one, other) for one, other in combinations(group, 2))
    models = {one.effects: tuple(model_of(variant, union) for variant in one.variants) for one in group}
    recorded = search.problem.total_a[np.ix_(union, union)]
    return Rivalry(pairs, models, recorded, held_out_share(search.problem.blocks), search.problem.nuisance_count)


def draws_of(model: Model, products: Float[Array, "u u"], normals: Float[Array, "d n"]) -> Float[Array, "e u"]:
    """Coefficients that are possible according to the recordings: the fit, then one row per draw, ``(d + 1, u)``.

    Args:
        model: The fitted model.
        products: Weighted products of all columns in the recordings, ``(u, u)``.
        normals: Standard normal numbers, one row per draw, ``(d, n)``.
    """
    inner = model.basis.T @ products @ model.basis
    width = np.where(model.is_nuisance, 0.0, _per_size(model, products))
    precise = _solvable(inner + np.diag(model.prior + width))
    # With R the Cholesky factor of the precision, R^-1 z has the wanted covariance.
    upper = np.linalg.cholesky(precise).T
    steps = np.linalg.solve(upper, normals.T).T
    y = np.concatenate([model.y[None], np.clip(model.y + steps, model.lower, model.upper)])
    return y @ model.basis.T + model.shift


def distance(
    truth: Float[Array, "d u"], nuisance_count: int, model: Model, products: Float[Array, "u u"]
) -> Float[Array, " d"]:
    """Least weighted squared residual of a model that is fitted to the torque of other models.

    The difference of the costs of the two models' tolerance parameters is added.

    Args:
        truth: True coefficients, one row each, ``(d, u)``; tolerance parameters first.
        nuisance_count: Number of tolerance parameters.
        model: The model that is fitted.
        products: Products of all columns over all recordings, ``(u, u)``.
    """
    inner = _solvable(model.basis.T @ products @ model.basis + np.diag(model.prior))
    difference = truth - model.shift
    wanted = (model.basis.T @ products @ difference.T).T
    y = np.linalg.solve(inner, wanted.T).T
    # If a parameter violates its bounds, the fit is repeated within the bounds.
    for row in np.flatnonzero(((y < model.lower) | (y > model.upper)).any(axis=1)):
        y[row] = bounded_solve(inner, wanted[row], model.lower, model.upper)
    residual = difference - y @ model.basis.T
    prior = np.where(model.is_nuisance, model.prior, 0.0)
    prior_of_truth = np.zeros(len(model.shift))
    prior_of_truth[:nuisance_count] = prior[model.is_nuisance]
    squares = np.sum((residual @ products) * residual, axis=1)
    return np.maximum(squares + y**2 @ prior - truth**2 @ prior_of_truth, 0.0)


def power_of(gain: Float[Array, " d"], head_start: float, before: Float[Array, " d"]) -> Float[Array, " d"]:
    """Probability that a wrong model wins so few bootstrap replicates that it is no longer listed.

    The difference of the held-out losses of both models has the expectation ``gain`` and the variance ``4 gain`` of a
    noncentral chi-squared distribution. Over bootstrap replicates, which draw from all recordings, its variance is
    ``4 (gain + before)``.

    Args:
        gain: Expected increase of the wrong model's held-out loss by the planned recording.
        head_start: Loss of the wrong model minus loss of the true one in the existing recordings; zero or negative.
        before: Expected held-out loss of the wrong model in the existing recordings.
    """
    from scipy.special import ndtr, ndtri

    spread = 2.0 * np.sqrt(np.maximum(gain, 1e-12))
    replicates = 2.0 * np.sqrt(np.maximum(gain + before, 1e-12))
    return ndtr((gain + head_start + ndtri(contract_levels.LISTED) * replicates) / spread)


def power_of_hopeless(gain: Float[Array, " d"], lead: float, after: Float[Array, " d"]) -> Float[Array, " d"]:
    """Probability that a model fits so badly in every block that it is no longer compared with the true one.

    Args:
        gain: Expected increase of the wrong model's held-out loss by the planned recording.
        lead: Loss and price of the wrong model minus those of the true one in the existing recordings.
        after: Expected held-out loss of the wrong model in all recordings, including the planned one.
    """
    from scipy.special import ndtr

    # The loss varies between blocks like a noncentral chi-squared variable.
    bar = rules.HOPELESS_ERRORS * 2.0 * np.sqrt(np.maximum(after, 0.0)) + rules.HOPELESS_BEYOND
    return ndtr((gain + lead - bar) / (2.0 * np.sqrt(np.maximum(gain, 1e-12))))


def power_of_simpler(simple: Model, rich: Model, products: Float[Array, "u u"], recorded: Float[Array, "u u"]) -> float:
    """Probability that a richer law is ruled out if the simpler law that it contains is true.

    The richer law is kept as long as its additional part may exist without being seen, see `odds_of_richer` in
    `identification.diagnosis.search.richer_laws`.

    Args:
        simple: The model that is true.
        rich: The model that contains the simpler one.
        products: Products of all columns over all recordings, including the planned one, ``(u, u)``.
        recorded: Products of all columns over the existing recordings, ``(u, u)``.
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
    limit = np.log1p(values).sum() + 2.0 * np.log(contract_levels.LISTED / (1.0 - contract_levels.LISTED))
    return float(gammainc(len(more) / 2.0, max(limit, 0.0) / 2.0))


def _per_size(model: Model, products: Float[Array, "u u"]) -> Float[Array, " n"]:
    """Prior precision of each effect parameter about the fit: one deviation causes a share of the effects' torque."""
    columns = list(model.columns)
    theta = model.theta[columns]
    # The torque of all effects together counts as at least one standard deviation of the noise.
    energy = max(float(theta @ products[np.ix_(columns, columns)] @ theta), 1.0)
    own = np.sum(model.basis * (products @ model.basis), axis=0)
    return own / (rules.EXPECTED_SHARE**2 * energy)


def _solvable(a: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """The matrix with a small ridge on its diagonal, which is needed if no data determine a parameter."""
    return a + np.diag(1e-9 * np.diag(a) + 1e-12 * max(float(np.trace(a)) / max(len(a), 1), 1e-300))
