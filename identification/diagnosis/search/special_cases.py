"""Tests whether a fitted law differs from its special cases: simpler laws, or no effect at all.

A special case holds if certain numbers, computed from the fit, are zero. For example, Stribeck friction is Coulomb
friction if its excess at rest is zero. The certainty of a difference is one minus the p-value of Wald's test that these
numbers are zero. Here the certainty of a single comparison is enough. A finding has to differ from zero with a larger
certainty (`differs_from_simpler`).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from identification.diagnosis.columns.terms import Term
from identification.diagnosis.fit.fitting import Fitted
from identification.diagnosis.fit.full_fit import FullFit
from identification.gates.special_case import differs_from_simpler
from phantom_dyn.array_types import Array, Float
from phantom_dyn.effects.rival import SpecialCase
from phantom_dyn.model.robot import Robot

# Eigenvalues of a covariance below this share of the largest one are rounding errors and are not inverted.
_ROUNDING_SHARE = 1e-9
# A number of at most this magnitude counts as zero, because fits reach the bounds of coefficients with this accuracy.
_AT_BOUND = 1e-12


def certainty_of_difference(numbers: Float[Array, " k"], cov: Float[Array, "k k"]) -> float:
    """Probability that estimates are nearer to zero than these numbers if the true numbers are zero.

    It is one minus the p-value of Wald's test.

    Args:
        numbers: Estimates that are zero in a special case.
        cov: Their covariance.
    """
    from scipy.special import chdtr

    if not np.any(numbers):
        return 0.0
    std = np.sqrt(np.maximum(np.diag(cov), 1e-300))
    scaled = numbers / std
    inverse = np.linalg.pinv(cov / np.outer(std, std), rcond=_ROUNDING_SHARE, hermitian=True)
    return float(chdtr(len(numbers), scaled @ inverse @ scaled))


def nearest_case(robot: Robot, term: Term, fitted: FullFit) -> tuple[float, tuple[str, ...]] | None:
    """Certainty that an effect differs from its nearest special case in a full fit, and the effects of that case.

    The nearest case is the first one from which the effect does not differ. If the effect differs from all cases, the
    nearest is the one with the smallest certainty. The result is None for an effect without special cases.

    Args:
        robot: The given model.
        term: An effect of the fit.
        fitted: Fit of all parameters together.
    """
    if term.effect.inertial == "free":
        return None
    slices = fitted.slices_of(term)
    x, count = fitted.x[slices.indices], slices.count

    def cases(x: Array) -> tuple[SpecialCase, ...]:
        shape = tuple(x[count:].tolist()) or term.shape
        return term.effect.special_cases(robot, term.joint, x[:count], shape)

    of_other_shape = _cases_of_other_shape(robot, term, x) if len(x) == count else frozenset()
    return _first_equal_or_nearest(cases, x, fitted.presence_covariance(term), excluded=of_other_shape)


def simplest_effects(robot: Robot, term: Term, fitted: Fitted) -> tuple[tuple[str, str | None], ...] | None:
    """Effects and joints of the simplest law that describes a fitted term: the term's law, or a special case of it.

    The result is None if the special case is no effect at all. Shapes are taken as known.
    """
    nearest = nearest_case_at_shape(robot, term, fitted)
    if nearest is None or differs_from_simpler(nearest[0], effect_is_certain=True).passed:
        return (term.effect_joint,)
    return tuple((name, term.joint) for name in nearest[1]) or None


def nearest_case_at_shape(
    robot: Robot, term: Term, fitted: Fitted, names: tuple[str, ...] | None = None
) -> tuple[float, tuple[str, ...]] | None:
    """Nearest special case of an effect in a fit with fixed shapes, as in `nearest_case`.

    Args:
        robot: The given model.
        term: An effect of the fit.
        fitted: Fit with fixed shapes.
        names: Effects of the only special case that is tested; None to test all cases.
    """
    if term.effect.inertial == "free":
        return None
    columns = list(term.columns[:4] if term.effect.inertial == "point mass" else term.columns)
    at = np.searchsorted(fitted.active, columns)

    def cases(x: Array) -> tuple[SpecialCase, ...]:
        return term.effect.special_cases(robot, term.joint, x, term.shape)

    theta = fitted.theta[columns]
    of_other_shape = _cases_of_other_shape(robot, term, theta)
    return _first_equal_or_nearest(cases, theta, fitted.cov[np.ix_(at, at)], names, of_other_shape)


def _cases_of_other_shape(robot: Robot, term: Term, theta: Float[Array, " k"]) -> frozenset[tuple[str, ...]]:
    """Special cases of an effect that depend on its shape, so that a fit with fixed shapes cannot test them.

    The numbers of these cases change if the shape is scaled by one per cent.
    """
    at, near = (
        term.effect.special_cases(robot, term.joint, theta, tuple(scale * one for one in term.shape))
        for scale in (1.0, 1.01)
    )
    return frozenset(
        one.names for one, other in zip(at, near, strict=True) if one.names and np.any(one.numbers != other.numbers)
    )


def vanishes_at_bound(robot: Robot, term: Term, theta: Float[Array, " k"]) -> bool:
    """True if the coefficients of an effect are at a bound where its law makes no torque.

    Args:
        robot: The given model.
        term: An effect.
        theta: Coefficients of its columns.
    """
    cases = term.effect.special_cases(robot, term.joint, theta, term.shape)
    return bool(np.any(theta)) and any(
        not case.names and bool(np.all(np.abs(case.numbers) <= _AT_BOUND)) for case in cases
    )


def _first_equal_or_nearest(
    cases: Callable[[Array], tuple[SpecialCase, ...]],
    x: Float[Array, " k"],
    cov: Float[Array, "k k"],
    names: tuple[str, ...] | None = None,
    excluded: frozenset[tuple[str, ...]] = frozenset(),
) -> tuple[float, tuple[str, ...]] | None:
    """Certainty and effects of the first special case from which a fit does not differ, or else of the nearest case.

    The covariance of the numbers of a case follows from that of ``x`` to first order, by finite differences.

    Args:
        cases: Function from parameters to the special cases of the law, with their numbers.
        x: Fitted parameters.
        cov: Their covariance.
        names: Effects of the only special case that is tested; None to test all cases.
        excluded: Special cases that are not tested, by their effects.
    """
    step = 0.01 * np.sqrt(np.maximum(np.diag(cov), 1e-30))
    shifted, tested = [cases(x + row) for row in np.diag(step)], list[tuple[float, tuple[str, ...]]]()
    for k, case in enumerate(cases(x)):
        if case.names in excluded or names not in (None, case.names):
            continue
        slope = np.stack([(to[k].numbers - case.numbers) / s for to, s in zip(shifted, step, strict=True)], axis=1)
        tested.append((certainty_of_difference(case.numbers, slope @ cov @ slope.T), case.names))
        if not differs_from_simpler(tested[-1][0], effect_is_certain=True).passed:
            return tested[-1]
    return min(tested, key=lambda one: one[0], default=None)
