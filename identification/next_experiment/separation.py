"""Power of a planned recording to separate rivals, and the squared distance between their torques (T-optimality)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np

from identification.diagnosis.result import EffectAt
from identification.diagnosis.search.search import Search
from identification.engine.products.blocks import held_out_share
from identification.next_experiment.distance import distance, draws_of, power_of, power_of_hopeless, power_of_simpler
from identification.next_experiment.hypotheses import Hypothesis, Model, model_of, union_of
from phantom_dyn.array_types import Array, Float, Int
from phantom_dyn.random_streams import random_stream

# Draws of what the recordings leave possible, the fit itself beside them.
_DRAWS = 7
# Largest lead in sample of a rival that held-out data have left on the list, in squared standard deviations: any more
# is noise that its shapes have fitted. A rival that is behind is still on the list.
_AHEAD = 8.0


@dataclass(frozen=True)
class Pair:
    """Two explanations of the same finding."""

    one: Hypothesis
    other: Hypothesis


@dataclass(frozen=True)
class Rivalry:
    """Pairs of rivals with the fits from which the power of a recording to separate them follows.

    Attributes:
        pairs: To be separated.
        models: Fits of each explanation, by its effects.
        recorded: Products over what is recorded now.
        held_out: Share of the samples that is judged while it is held out.
        moves: How many of the columns are moves within the tolerances.
    """

    pairs: tuple[Pair, ...]
    models: dict[tuple[EffectAt, ...], tuple[Model, ...]]
    recorded: Float[Array, "u u"]
    held_out: float
    moves: int

    @cached_property
    def left_open(self) -> dict[tuple[EffectAt, ...], dict[tuple[EffectAt, ...], _LeftOpen]]:
        """What the recordings leave open if one explanation is true, by that one and by the other of the pair.

        It is the same for every planned motion, so that motions are compared and not draws.
        """
        rng = random_stream("models that recordings leave possible")
        out: dict[tuple[EffectAt, ...], dict[tuple[EffectAt, ...], _LeftOpen]] = {}
        for pair in self.pairs:
            for truth, wrong in ((pair.one, pair.other), (pair.other, pair.one)):
                model = self.models[truth.effects][0]
                normals = rng.normal(size=(_DRAWS, model.basis.shape[1]))
                possible = draws_of(model, self.recorded, normals)
                before = tuple(self.apart(possible, other, self.recorded) for other in self.models[wrong.effects])
                out.setdefault(truth.effects, {})[wrong.effects] = _LeftOpen(possible, before)
        return out

    def apart(self, possible: Float[Array, "d u"], wrong: Model, products: Float[Array, "u u"]) -> Float[Array, " d"]:
        """Expected held-out loss of a wrong model, for each of what may be true."""
        return self.held_out * distance(possible, self.moves, wrong, products)


@dataclass(frozen=True)
class _LeftOpen:
    """What the recordings leave open if one of two explanations is true.

    Attributes:
        possible: Coefficients that may be true, ``(d, u)``.
        before: Expected held-out loss of each model of the other explanation in what is recorded now, ``(d,)`` each.
    """

    possible: Float[Array, "d u"]
    before: tuple[Float[Array, " d"], ...]


def rivalry_of(search: Search, groups: tuple[tuple[Hypothesis, ...], ...]) -> tuple[Rivalry, ...]:
    """One rivalry for each finding, over the union of the columns of all."""
    union = union_of(tuple(one for group in groups for one in group))
    return tuple(_rivalry(search, group, union) for group in groups)


@dataclass(frozen=True)
class Separation:
    """Expected separation of one finding's rivals by a recording.

    Attributes:
        power: Probability that it separates each pair, averaged over which of the two is true.
        gain: Squared distance of each pair.
        resolved: Probability that the rival which is hardest to strike off is struck off, over what is true.
    """

    power: Float[Array, " p"]
    gain: Float[Array, " p"]
    resolved: float


def separation(rivalry: Rivalry, planned: Float[Array, "u u"]) -> Separation:
    """Expected separation of one finding's rivals by a planned recording.

    Args:
        rivalry: Pairs of rivals with their fits.
        planned: Products over the recording.
    """
    together = rivalry.recorded + planned
    chance, apart = [], []
    hardest: dict[tuple[EffectAt, ...], float] = {}
    likely: dict[tuple[EffectAt, ...], float] = {}
    for pair in rivalry.pairs:
        shares, gains, weights = [], [], []
        for truth, wrong in ((pair.one, pair.other), (pair.other, pair.one)):
            if wrong.contains(truth):
                shares.append(_simpler_left(rivalry, truth, wrong, together))
            else:
                power, gain = _separated(rivalry, truth, wrong, together)
                shares.append(power)
                gains.append(gain)
            weights.append(max(truth.probability, 1e-3))
            hardest[truth.effects] = min(hardest.get(truth.effects, 1.0), shares[-1])
            likely[truth.effects] = weights[-1]
        chance.append(float(np.average(shares, weights=weights)))
        apart.append(min(gains, default=0.0))
    resolved = float(np.average(list(hardest.values()), weights=list(likely.values())))
    return Separation(np.array(chance), np.array(apart), resolved)


def _separated(
    rivalry: Rivalry,
    truth: Hypothesis,
    wrong: Hypothesis,
    together: Float[Array, "u u"],
) -> tuple[float, float]:
    """Mean probability that the wrong explanation is struck off, over what may be true, and the median gain."""
    model, left_open = rivalry.models[truth.effects][0], rivalry.left_open[truth.effects][wrong.effects]
    count = len(left_open.possible)
    power, gain = np.full(count, np.inf), np.full(count, np.inf)
    for other, before in zip(rivalry.models[wrong.effects], left_open.before, strict=True):
        more = np.maximum(rivalry.apart(left_open.possible, other, together) - before, 0.0)
        ahead = float(np.clip(other.score - model.score, -_AHEAD, 0.0))
        power = np.minimum(power, power_of(more, ahead, before))
        gain = np.minimum(gain, more)
    return float(power.mean()), float(np.median(gain))


def _simpler_left(
    rivalry: Rivalry,
    truth: Hypothesis,
    wrong: Hypothesis,
    together: Float[Array, "u u"],
) -> float:
    """Mean probability that a richer law is struck off if the simpler one is true.

    It stays on the list as long as any of its shapes may be there. A shape is gone if what it has more would have been
    seen, or, where the law comes to the simpler one only at the end of its shapes, if it fits too badly.
    """
    model, left_open = rivalry.models[truth.effects][0], rivalry.left_open[truth.effects][wrong.effects]
    power = np.full(len(left_open.possible), np.inf)
    for rich, before in zip(rivalry.models[wrong.effects], left_open.before, strict=True):
        after = rivalry.apart(left_open.possible, rich, together)
        lead = max(rich.score - model.score, -_AHEAD)
        worse = power_of_hopeless(np.maximum(after - before, 0.0), lead, after)
        unseen = power_of_simpler(model, rich, together, rivalry.recorded)
        power = np.minimum(power, np.maximum(worse, unseen))
    return float(power.mean())


def _rivalry(search: Search, group: tuple[Hypothesis, ...], union: Int[Array, " u"]) -> Rivalry:
    pairs = tuple(Pair(one, other) for one, other in combinations(group, 2))
    models = {one.effects: tuple(model_of(search, variant, union) for variant in one.variants) for one in group}
    recorded = search.problem.total_a[np.ix_(union, union)]
    return Rivalry(pairs, models, recorded, held_out_share(search.problem.blocks), search.problem.nuisances)
