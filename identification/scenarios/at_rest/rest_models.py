r"""Fits of backlash, compliance, or both to the positions of one joint at standstill under load.

With the motor at its reference, the link is at :math:`q - q_{ref} = c - \frac{g}{2} s - \tau_l / k`. Here
:math:`\tau_l` is the load that the transmission passes to the link, :math:`s` its sign, :math:`g` the full width of the
backlash, :math:`k` the stiffness, and :math:`c` a constant of reading and reference. If all loads have the same size,
backlash cannot be separated from a spring.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification.diagnosis import decision_rules as rules
from identification.engine.claims import GateResult
from identification.engine.products.block_products import block_products, held_out_residual
from identification.engine.resampling import block_counts, probabilities, share_by_likelihood
from identification.gates.above_chance import more_than_chance
from identification.gates.special_case import both_are_there
from identification.scenarios.at_rest.rests import StandstillSamples
from phantom_dyn.array_types import Array, Float
from phantom_dyn.random_streams import random_stream

# Smallest number of rests under each sign of load: fewer do not show how well rests repeat.
LEAST_RESTS = 3
# Loads whose sizes differ by less than this share of their mean count as equal: modelled loads are no more accurate.
_ALIKE = 0.2
# Smallest standard deviation, for rests that are exactly equal; a number divided by it can still be squared.
_NO_DEVIATION = 1e-150
# The models that are fitted to the rests, each given by its effects in the catalogue.
REST_MODELS = (("backlash",), ("transmission_compliance",), ("backlash", "transmission_compliance"))


@dataclass(frozen=True)
class RestModel:
    """One model of how a joint gives way under load, fitted to the rests.

    Attributes:
        effects: Names of its effects in the catalogue.
        values: Full width of the backlash [rad or m], or compliance [rad/(N m) or m/N], one for each effect.
        std: Their standard deviations.
        residual: Residual of each rest by the fit to all others, ``(R,)``.
    """

    effects: tuple[str, ...]
    values: Float[Array, " k"]
    std: Float[Array, " k"]
    residual: Float[Array, " R"]


@dataclass(frozen=True)
class RestFits:
    """Fits to the rests of one joint.

    Attributes:
        before: Error of each rest minus the mean of all others, ``(R,)``.
        models: Fitted models, the most probable first; empty if the shift may be chance.
        probabilities: Probability of each model, see `engine.resampling`.
        replicates: Share of the gap that the first model explains, in each bootstrap replicate.
        shift: Distance between the rests under loads of opposite sign [rad or m].
        detectable_size: The smallest shift that would be claimed in 95 of 100 such recordings.
        above_chance: Whether the shift is larger than chance explains; both numbers are squares in units of the shift's
            standard deviation.
        both_needed: Whether backlash and compliance both differ from zero when fitted together; None if this cannot be
            tested, because all loads have the same size or there are too few rests.
    """

    before: Float[Array, " R"]
    models: tuple[RestModel, ...]
    probabilities: tuple[float, ...]
    replicates: Float[Array, " B"]
    shift: float
    detectable_size: float
    above_chance: GateResult
    both_needed: GateResult | None = None


def testable(standstill: StandstillSamples) -> bool:
    """True if the joint rests often enough under loads of either sign."""
    load = standstill.rest_medians(standstill.load)
    return bool(min(np.sum(load > 0), np.sum(load < 0)) >= LEAST_RESTS)


def fitted_rests(standstill: StandstillSamples) -> RestFits:
    """Fits of backlash and compliance to the rests of a joint; each rest is predicted by fits without it.

    Args:
        standstill: Samples at rest under loads of either sign.
    """
    from scipy.special import stdtr, stdtrit

    error, load = standstill.rest_medians(standstill.error), standstill.rest_medians(standstill.load)
    load_sign = np.sign(load)
    before = _fit(error, ()).residual
    shift = _fit(error, (("backlash", -0.5 * load_sign),))
    width = float(shift.values[0])
    # Rounding to steps of the reading gives at least the standard deviation of a uniform error.
    deviation = max(float(shift.std[0]), standstill.quantum / np.sqrt(12.0 * len(error)), _NO_DEVIATION)
    needed = -float(stdtrit(len(error) - 2, rules.REST_CHANCE))
    detectable_size = (needed + 1.645) * deviation  # 1.645 standard deviations: 95 % on one side
    above_chance = more_than_chance(float(np.sign(width)) * (width / deviation) ** 2, needed**2)
    if not above_chance.passed:
        return RestFits(before, (), (), np.zeros(0), width, detectable_size, above_chance)
    columns = {"backlash": -0.5 * load_sign, "transmission_compliance": -load}
    sizes = np.abs(load)
    alike = sizes.max() - sizes.min() < _ALIKE * sizes.mean()
    models = [_fit(error, tuple((name, columns[name]) for name in names)) for names in REST_MODELS]
    both = None
    if len(error) > 6 and not alike:
        # The third model, backlash and compliance together, is used only if each of them differs from zero.
        confidence = stdtr(len(error) - 3, models[2].values / np.maximum(models[2].std, 1e-300))
        both = both_are_there(float(confidence.min()))
    models = models if both is not None and both.passed else models[:2]
    losses = np.array([model.residual**2 for model in models]).T
    odds = np.full(len(models), 1.0 / len(models)) if alike else _probabilities(losses)
    ranked = sorted(range(len(models)), key=lambda k: (-odds[k], k))
    weights = block_counts(len(error), random_stream("bootstrap of rests")) / len(error)
    loss_before = weights @ before**2
    closed = (loss_before - weights @ losses[:, ranked[0]]) / np.maximum(
        loss_before - standstill.repeatability**2, 1e-300
    )
    return RestFits(
        before,
        tuple(models[k] for k in ranked),
        tuple(float(odds[k]) for k in ranked),
        closed,
        width,
        detectable_size,
        above_chance,
        both,
    )


def _probabilities(losses: Float[Array, "R m"]) -> Float[Array, " m"]:
    """Probability of each model by its losses; the residuals of the best model give the noise of a rest."""
    noise = max(float(losses.mean(axis=0).min()), 1e-300)
    return probabilities(losses / noise, (np.zeros(losses.shape[1]),), lead=share_by_likelihood)


def _fit(error: Float[Array, " R"], columns: tuple[tuple[str, Float[Array, " R"]], ...]) -> RestModel:
    """Least squares with a constant; the residual of each rest is held out, from the fit to all other rests."""
    x = np.column_stack([np.ones_like(error), *(column for _, column in columns)])
    every, rests = list(range(x.shape[1])), np.arange(len(error))
    products = block_products(x, error, np.ones(len(error)), rests, len(error))
    inverse = np.linalg.pinv(products.gram.sum(axis=0))
    theta = inverse @ products.right.sum(axis=0)
    residual = error - x @ theta
    variance = float(residual @ residual) / max(len(error) - x.shape[1], 1)
    std = np.sqrt(variance * np.diag(inverse))
    held_out = held_out_residual(x, error, rests, products.fits_without_each(every))
    return RestModel(tuple(name for name, _ in columns), theta[1:], std[1:], held_out)
