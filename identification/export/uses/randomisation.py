"""Domain randomisation: distribution of the effects that a diagnosis found, and of effects that it cannot rule out.

Found effects are drawn from their joint normal distribution, with correlations if the diagnosis has them. Effects that
were not found are drawn uniformly between zero and their detection limit, only a few at a time, as many together would
have been found. The range of a found parameter extends two standard deviations to either side of its value.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice

import numpy as np
from scipy.linalg import block_diag

from identification.diagnosis.columns.terms import KnownEffect
from identification.diagnosis.result import Bound, Diagnosis, Finding
from identification.export.corrected.found_effects import effect_of, findings_in_all_recordings, loadings_of
from phantom_dyn.array_types import Array, Float
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.effect import Parameter
from phantom_dyn.model.robot import Robot

SIGMAS = 2.0
"""Half the width of a found parameter's range, in standard deviations."""
_NEARLY_ABSENT = 1e-3
"""At this share of the largest size, a parameter is close to its value without the effect."""


@dataclass(frozen=True)
class Randomisation:
    """Distribution of a robot after a diagnosis: effects that were found, and effects that may exist unseen.

    Attributes:
        robot: The given model.
        findings: Findings of the diagnosis.
        found: The effects of these findings, with parameters in the order of the catalogue.
        loadings: Matrix that maps ``k`` independent standard normal numbers to the errors of all ``p`` parameters.
        unseen: Detection limits of the effects that were not found.
        control_step: Time between commands [s], taken as the time between samples; None if unknown.
        posture: Mean recorded positions [rad or m]; None means zero.
    """

    robot: Robot
    findings: tuple[Finding, ...]
    found: tuple[KnownEffect, ...]
    loadings: Float[Array, "p k"]
    unseen: tuple[Bound, ...]
    control_step: float | None
    posture: Float[Array, " nv"] | None = None

    @property
    def values(self) -> Float[Array, " p"]:
        """Parameters of all found effects, one effect after the other."""
        return np.array([x for effect in self.found for x in effect.theta])

    def with_values(self, values: Float[Array, " p"]) -> tuple[KnownEffect, ...]:
        """The found effects with other parameters, in the order of `values`."""
        remaining = iter(values.tolist())
        return tuple(KnownEffect(one.effect, one.joint, tuple(islice(remaining, len(one.theta)))) for one in self.found)

    @property
    def std(self) -> Float[Array, " p"]:
        """Standard deviations of `values`."""
        return np.sqrt((self.loadings**2).sum(axis=1))

    @property
    def correlation(self) -> Float[Array, "p p"]:
        """Correlations of `values`; zero where a standard deviation is zero."""
        std = self.std
        scale = np.where(std > 0, std, 1.0)
        out = self.loadings @ self.loadings.T / np.outer(scale, scale)
        np.fill_diagonal(out, 1.0)
        return np.clip(out, -1.0, 1.0)


def randomisation_of(diagnosis: Diagnosis, robot: Robot) -> Randomisation:
    """Distribution of a robot after a diagnosis.

    Args:
        diagnosis: The diagnosis.
        robot: The given model.
    """
    findings = findings_in_all_recordings(diagnosis)
    found = tuple(effect_of(robot, finding) for finding in findings)
    parts = [loadings_of(robot, finding) for finding in findings]
    shared = bool(parts) and all(f.loadings for f in findings) and len({p.shape[1] for p in parts}) == 1
    unseen = tuple(bound for bound in diagnosis.bounds if np.isfinite(bound.below) and bound.below > 0)
    loadings = np.vstack(parts) if shared else np.asarray(block_diag(*parts, np.zeros((0, 0))))
    posture = diagnosis.evidence.q.mean(axis=0) if len(diagnosis.evidence.q) else None
    return Randomisation(robot, findings, found, loadings, unseen, diagnosis.evidence.sample_period, posture)


def unseen_effect(randomisation: Randomisation, bound: Bound, share: float) -> KnownEffect | None:
    """An unseen effect with a share of its largest size; None if the size alone does not define the effect."""
    robot, posture = randomisation.robot, randomisation.posture
    posture = np.zeros(robot.nv) if posture is None else posture
    theta = effect_named(bound.effect, robot).sized(robot, bound.joint, bound.parameter, share * bound.below, posture)
    return None if theta is None else KnownEffect(bound.effect, bound.joint, theta)


def unseen_sizes(robot: Robot, bound: Bound) -> tuple[float, float]:
    """Range of sizes that would not have been seen; a size is a parameter's distance from its value without effect."""
    parameters = effect_named(bound.effect, robot).parameters(robot, bound.joint)
    either_sign = any(parameter.either_sign for parameter in parameters if parameter.name == bound.parameter)
    return (-bound.below if either_sign else 0.0, bound.below)


@dataclass(frozen=True)
class UnseenRange:
    """Range of a parameter of an effect that was not seen, with the parameter and unit that a finding would state.

    Attributes:
        parameter: Name of the parameter in the catalogue.
        unit: Unit of the parameter.
        low: Lower end of the range.
        high: Upper end of the range; infinite if an infinite parameter means no effect, as for a stiffness.
        nothing: Value of the parameter without the effect: 1 for a factor, infinity for a stiffness, otherwise 0.
    """

    parameter: str
    unit: str
    low: float
    high: float
    nothing: float


def unseen_range(robot: Robot, bound: Bound) -> UnseenRange:
    """Range of an effect's parameter over all sizes that would not have been seen.

    The size in a bound is not always the effect's parameter. For example, an error of a ratio of up to 0.04 means a
    ratio of 0.96 to 1.04, and a compliance of up to 0.001 means a stiffness of 1000 or more.
    """
    effect = effect_named(bound.effect, robot)
    low, high = unseen_sizes(robot, bound)
    parameters = effect.parameters(robot, bound.joint)
    names = [parameter.name for parameter in parameters]
    # If no parameter has the name of the size, the size determines the first parameter.
    index = names.index(bound.parameter) if bound.parameter in names else 0
    chosen = parameters[index]

    def value_at(size: float) -> float | None:
        theta = effect.sized(robot, bound.joint, bound.parameter, size, np.zeros(robot.nv))
        return None if theta is None else float(np.clip(theta[index], chosen.lower, chosen.upper))

    at_largest, at_slight = value_at(high), value_at(_NEARLY_ABSENT * high)
    # If the size alone does not define an effect, the size is the value of the parameter.
    if at_largest is None or at_slight is None:
        return UnseenRange(bound.parameter, bound.unit, low, high, 0.0)
    # Size zero or the lowest size may have no value (compliance 0: infinite stiffness). The range then ends at the
    # bound that the parameter approaches as the size decreases.
    far_bound = chosen.lower if at_largest > at_slight else chosen.upper
    without_effect, at_low = value_at(0.0), value_at(low)
    without_effect = far_bound if without_effect is None else without_effect
    ends = at_largest, far_bound if at_low is None else at_low
    return UnseenRange(chosen.name, chosen.unit, min(ends), max(ends), without_effect)


def found_range(randomisation: Randomisation, place: int) -> tuple[float, float]:
    """Range of one found parameter: two standard deviations to either side of its value, cut at its bounds."""
    low, high = _bounds(randomisation)
    value, half = randomisation.values[place], SIGMAS * randomisation.std[place]
    # A value outside the bounds (for example less friction than in the given model) extends the range to the value.
    return float(max(value - half, min(low[place], value))), float(min(value + half, max(high[place], value)))


def parameters_of(robot: Robot, effect: KnownEffect) -> list[tuple[str, Parameter]]:
    """Name and parameter of each number of an effect; if a parameter is a list, names end with an index."""
    parameters = effect_named(effect.effect, robot).parameters(robot, effect.joint)
    each = max(len(effect.theta) // len(parameters), 1)
    names = [(p.name + (f"[{k}]" if each > 1 else ""), p) for p in parameters for k in range(each)]
    return names[: len(effect.theta)]


def _bounds(randomisation: Randomisation) -> tuple[Array, Array]:
    """Lower and upper bounds of all found parameters, from the catalogue."""
    parameters = [p for effect in randomisation.found for _, p in parameters_of(randomisation.robot, effect)]
    return np.array([p.lower for p in parameters]), np.array([p.upper for p in parameters])
