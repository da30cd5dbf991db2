"""Warnings about an estimate: inseparable, ill-conditioned or bounded parameters, and recordings at a limit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum, auto

import numpy as np

from identification.regression.base_parameters import BaseParameters
from identification.regression.regressor import Regressor, RegressorTerm
from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import ParameterError
from phantom_dyn.model.robot import Robot, position_limits

_POOR_CONDITION = 1000.0  # condition number above which a relative error of 1e-3 in a column may double a parameter
_AT_BOUND = 2.0  # a value closer to its bound than this many standard deviations counts as at the bound
_NAMED = 0.3  # parameters with at least this share of the largest weight in the worst determined combination are named
# A joint counts as resting on its stop if it is slower than the first share of its largest speed, and closer to the
# stop than the second share of its range. It is reported if it rests in more than the third share of the samples.
_STANDSTILL, _NEAR, _OFTEN = 1e-2, 1e-3, 5e-3
_NOTHING = 100.0  # relative error of a model that predicts no torque [%]
_CLIPPED = 0.999  # share of a torque limit above which the drive is at its limit


class About(Enum):
    """Subject of a warning, by which callers select warnings."""

    SEPARATION = auto()
    BOUND = auto()
    OTHER = auto()


@dataclass(frozen=True)
class Caution:
    """A warning as a sentence, its subject, and the coefficients that it names."""

    sentence: str
    about: About = About.OTHER
    names: tuple[str, ...] = ()


def condition_of(factor: Float[Array, "r r"]) -> float:
    """Condition number of equations with columns of norm one, from their triangular factor."""
    scaled = np.linalg.svd(factor / np.linalg.norm(factor, axis=0), compute_uv=False)
    return float(scaled[0] / scaled[-1])


def cautions(
    regressor: Regressor,
    base: BaseParameters,
    theta: Float[Array, " r"],
    std: Float[Array, " r"],
    factor: Float[Array, "r r"],
) -> tuple[Caution, ...]:
    """Warnings on parameters that are inseparable, ill-conditioned or at a bound, and on recordings at a limit.

    Args:
        regressor: The equations.
        base: The unknowns.
        theta: Values of the unknowns.
        std: Standard deviations of the unknowns, NaN if they are not known.
        factor: Triangular factor of the equations.
    """
    others = (*_at_stops(regressor), *_at_torque_limits(regressor))
    return (
        *_not_separable(regressor, base),
        *map(Caution, (*_ill_conditioned(base, factor), *_uncertain(std))),
        *_at_bounds(regressor, base, theta, std),
        *map(Caution, others),
    )


def misfit_sentences(robot: Robot, error: Float[Array, " nv"]) -> Iterator[str]:
    """A sentence on each joint whose residual is larger than its torque.

    Args:
        robot: The robot.
        error: Root mean square of the residual divided by that of the measured torque [%], NaN without torque.
    """
    for joint, share in zip(robot.joint_names, error, strict=True):
        if share > _NOTHING:
            yield (
                f"The fit misses the torque of {joint} by {share:.3g} % of its size, more than no model would: check "
                "its sign and gain, or use an estimator that weighs joints by their noise, such as wls."
            )


def _not_separable(regressor: Regressor, base: BaseParameters) -> Iterator[Caution]:
    """A warning on coefficients of effects that are combinations of other columns."""
    names = tuple(regressor.names[k] for k in base.dependent if k >= regressor.first_effect)
    if names:
        yield Caution(
            f"Not separable from other parameters in this recording: {', '.join(names)}; see the regroupings, or "
            "record a motion that separates them.",
            About.SEPARATION,
            names,
        )


def _ill_conditioned(base: BaseParameters, factor: Array) -> Iterator[str]:
    """A sentence on the condition number if it is large, with the parameters of the worst determined combination."""
    condition = condition_of(factor)
    if condition > _POOR_CONDITION:
        weakest = np.linalg.svd(factor / np.linalg.norm(factor, axis=0))[2][-1]
        share = np.abs(weakest) / np.abs(weakest).max()
        named = [base.base_names[k] for k in np.argsort(-share, kind="stable")[:4] if share[k] >= _NAMED]
        yield (
            f"The condition number is {condition:.3g}: small errors in the motion change the estimates a lot, most of "
            f"all those of {', '.join(named)}; record a motion that excites them more."
        )


def _uncertain(std: Array) -> Iterator[str]:
    """A sentence on standard deviations if none is known."""
    if np.isnan(std).all():
        yield "There are no more equations than unknowns, so that no uncertainty can be given: record more."


def _at_bounds(regressor: Regressor, base: BaseParameters, theta: Array, std: Array) -> Iterator[Caution]:
    """A warning on each coefficient that is near a physical bound or beyond it."""
    first = regressor.first_effect
    bounds = coefficient_bounds(regressor.robot, regressor.terms, regressor.names[first:])
    lower, upper = (bound + 0.0 for bound in bounds)  # no "-0" in sentences
    # A coefficient into which others are regrouped has no bounds.
    alone = [not row.any() for row in np.abs(base.grouping) > 1e-9]
    for k, column in enumerate(base.independent):
        if column < first or not alone[k]:
            continue
        least, most = lower[column - first], upper[column - first]
        for bound, side, beyond in ((least, "lower", theta[k] - least), (most, "upper", most - theta[k])):
            if not np.isfinite(bound) or not beyond <= _AT_BOUND * std[k]:
                continue
            finding = f"at its {side} bound of {bound:.4g} within its uncertainty: its effect may be absent."
            if beyond < -_AT_BOUND * std[k]:
                finding = (
                    f"beyond its {side} bound of {bound:.4g}, which is impossible: something that the model "
                    "lacks takes its place; check the torque's sign and delay, or add effects."
                )
            name = base.names[column]
            value = f"{name} is {theta[k]:.4g} {base.units[column]}".rstrip()
            yield Caution(f"{value}, {finding}", About.BOUND, (name,))


def coefficient_bounds(
    robot: Robot, terms: Sequence[RegressorTerm], names: Sequence[str]
) -> tuple[Float[Array, " e"], Float[Array, " e"]]:
    """Physical bounds of the coefficients of terms, ``-inf`` and ``inf`` without a bound.

    Args:
        robot: The robot. Its friction and rotor inertia shift the bounds of coefficients that add to them.
        terms: Terms of a regressor, in the order of its columns.
        names: Names of the coefficients of all terms.
    """
    given = []
    for term in terms:
        # The same effect may act with two different shapes; the terms then have the same label.
        same = sum(other.label == term.label for other in terms)
        count = sum(name.startswith(f"{term.label}.") for name in names) // same
        bounds = term.effect.coefficient_bounds(robot, term.joint, term.shape)
        given += list(bounds) if len(bounds) == count else [(-np.inf, np.inf)] * count
    if len(given) != len(names):
        raise ParameterError(f"{len(names)} coefficients belong to terms with {len(given)}: give the terms of the fit.")
    pairs = np.array(given, dtype=float).reshape(-1, 2)
    return pairs[:, 0], pairs[:, 1]


def _at_stops(regressor: Regressor) -> Iterator[str]:
    """A sentence on each joint that rests at a position limit, by recording."""
    lower, upper = position_limits(regressor.robot)
    units = regressor.robot.position_units
    for log in regressor.logs:
        q, v = log.motion.q[log.valid], log.motion.v[log.valid]
        if not len(q):
            continue
        standstill = np.abs(v) < _STANDSTILL * np.abs(v).max(axis=0)
        # A joint without limits has no stop.
        near = np.where(np.isfinite(lower) & np.isfinite(upper), _NEAR * (upper - lower), -np.inf)
        for side, bound, gap in (("lower", lower, q - lower), ("upper", upper, upper - q)):
            share = np.mean(standstill & (gap <= near), axis=0)
            for j in np.flatnonzero(share > _OFTEN):
                yield (
                    f"{log.file}: {log.joint_names[j]} rests at its {side} limit of {bound[j]:.4g} {units[j]} in "
                    f"{100 * share[j]:.2g} % of the samples, where the stop may carry torque that parameters then "
                    "explain: leave these stretches out (--exclude) or record with less range."
                )


def _at_torque_limits(regressor: Regressor) -> Iterator[str]:
    """A sentence on each drive that reaches its torque limit, by recording."""
    for log in regressor.logs:
        for j, actuator in enumerate(regressor.robot.actuators):
            if actuator.torque_limit is None:
                continue
            share = np.mean(np.abs(log.tau[log.valid, j]) >= _CLIPPED * actuator.torque_limit) if log.valid.any() else 0
            if share > 0:
                yield (
                    f"{log.file}: the drive of {log.joint_names[j]} is at its limit of {actuator.torque_limit:.4g} "
                    f"{regressor.robot.torque_units[j]} in {100 * share:.2g} % of the samples, where it gives less "
                    "than it is asked for: leave these stretches out (--exclude)."
                )
