"""Draws of robots for training in simulation: from what a diagnosis found, and from what may be there unseen.

What was found is drawn from its joint normal distribution, correlations included where the diagnosis knows them. What
was not seen is drawn evenly between nothing and the smallest size that the recordings would have shown; few at a time,
as together they would have been seen. Ranges are two deviations to either side.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice

import numpy as np
from scipy.linalg import block_diag

from identification.diagnosis.columns.terms import KnownEffect
from identification.diagnosis.result import Bound, Diagnosis, Finding
from identification.export.corrected.found_effects import effect_of, lasting_findings, loadings_of
from phantom_dyn.array_types import Array, Float
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.errors import ParameterError
from phantom_dyn.model.robot import Robot

SIGMAS = 2.0
"""Half width of a range in deviations."""
_SLIGHT = 1e-3
"""Share of a size at which an effect is nearly absent: it shows towards which value its parameter fades out."""


@dataclass(frozen=True)
class Randomisation:
    """Distribution of a robot after a diagnosis: what was found, and what may be there unseen.

    Attributes:
        robot: The given model.
        findings: Of the diagnosis.
        found: The same as effects with their parameters in order.
        loadings: Deviations of all their numbers as sums of ``k`` independent standard numbers, ``(p, k)``.
        unseen: Effects that were not seen, with the size from which they would have been.
        control_step: Time from one command to the next [s], or None.
        posture: Mean recorded positions [rad or m]; the zero posture by default.
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
        """All numbers of what was found, one effect after the other."""
        return np.array([x for effect in self.found for x in effect.theta])

    def with_values(self, values: Float[Array, " p"]) -> tuple[KnownEffect, ...]:
        """The effects that were found, with these numbers."""
        rest = iter(values.tolist())
        return tuple(KnownEffect(one.effect, one.joint, tuple(islice(rest, len(one.theta)))) for one in self.found)

    @property
    def std(self) -> Float[Array, " p"]:
        """Their deviations."""
        return np.sqrt((self.loadings**2).sum(axis=1))

    @property
    def correlation(self) -> Float[Array, "p p"]:
        """Their correlations; zero with what has no deviation."""
        std = self.std
        scale = np.where(std > 0, std, 1.0)
        out = self.loadings @ self.loadings.T / np.outer(scale, scale)
        np.fill_diagonal(out, 1.0)
        return np.clip(out, -1.0, 1.0)


def randomisation_of(diagnosis: Diagnosis, robot: Robot, *, control_step: float | None = None) -> Randomisation:
    """Distribution of a robot after a diagnosis.

    Args:
        diagnosis: What was found, and what was not seen.
        robot: The given model.
        control_step: Time from one command to the next [s]; by default that between samples of the recordings.

    Raises:
        ParameterError: If the control step is not a positive number.
    """
    step = diagnosis.evidence.sample_period if control_step is None else control_step
    if step is not None and not (np.isfinite(step) and step > 0):
        raise ParameterError(f"The control step is {step} s, wanted a time above zero: give it in seconds.")
    findings = lasting_findings(diagnosis)
    found = tuple(effect_of(robot, finding) for finding in findings)
    parts = [loadings_of(robot, finding) for finding in findings]
    shared = bool(parts) and all(f.loadings for f in findings) and len({p.shape[1] for p in parts}) == 1
    unseen = tuple(bound for bound in diagnosis.bounds if np.isfinite(bound.below) and bound.below > 0)
    loadings = np.vstack(parts) if shared else np.asarray(block_diag(*parts, np.zeros((0, 0))))
    posture = diagnosis.evidence.q.mean(axis=0) if len(diagnosis.evidence.q) else None
    return Randomisation(robot, findings, found, loadings, unseen, step, posture)


def draws(
    randomisation: Randomisation, count: int, rng: np.random.Generator, *, unseen: int = 1
) -> tuple[tuple[KnownEffect, ...], ...]:
    """Robots drawn at random: the effects of each, for `corrected_model` or a simulation.

    Args:
        randomisation: Distribution of the robot.
        count: How many robots.
        rng: Random numbers.
        unseen: How many of the effects that were not seen each robot has besides.

    Raises:
        ParameterError: If a number is below zero.
    """
    if count < 0 or unseen < 0:
        raise ParameterError(f"{count} draws with {unseen} unseen effects were asked for: give numbers from 0 on.")
    known = tuple(bound for bound in randomisation.unseen if unseen_effect(randomisation, bound, 1.0) is not None)
    normal = rng.standard_normal((count, randomisation.loadings.shape[1]))
    values = randomisation.values + normal @ randomisation.loadings.T
    return tuple(
        (*_drawn(randomisation, row), *_hidden(randomisation, known, rng, min(unseen, len(known)))) for row in values
    )


def unseen_effect(randomisation: Randomisation, bound: Bound, share: float) -> KnownEffect | None:
    """An effect of a share of the size that would have been seen; None where the size alone does not make one."""
    robot, posture = randomisation.robot, randomisation.posture
    posture = np.zeros(robot.nv) if posture is None else posture
    theta = effect_named(bound.effect, robot).sized(robot, bound.joint, bound.parameter, share * bound.below, posture)
    return None if theta is None else KnownEffect(bound.effect, bound.joint, theta)


def unseen_sizes(robot: Robot, bound: Bound) -> tuple[float, float]:
    """Range of sizes that would not have been seen on a robot; a size is how far from nothing an effect is."""
    known = effect_named(bound.effect, robot).parameters(robot, bound.joint)
    either = any(one.either_sign for one in known if one.name == bound.parameter)
    return (-bound.below if either else 0.0, bound.below)


@dataclass(frozen=True)
class UnseenRange:
    """Where a parameter of an effect that was not seen may lie, as a finding of that effect would state it.

    Attributes:
        parameter: The contract's name.
        unit: Its unit.
        low, high: The range; infinite where the effect fades out towards infinity, as a stiffness does.
        nothing: Value of a robot without the effect: 1 of a factor, infinite of a stiffness, else 0.
    """

    parameter: str
    unit: str
    low: float
    high: float
    nothing: float


def unseen_range(robot: Robot, bound: Bound) -> UnseenRange:
    """Range of the parameter of an effect between sizes that would not have been seen on a robot.

    A bound is a size, which is not always what the effect's parameter is: a ratio that is off by 0.04 is 0.96 to 1.04,
    a compliance of 0.001 at most is a stiffness of 1000 and more.
    """
    effect = effect_named(bound.effect, robot)
    low, high = unseen_sizes(robot, bound)
    parameters = effect.parameters(robot, bound.joint)
    names = [parameter.name for parameter in parameters]
    # What is sized under another name is what the first parameter comes from.
    place = names.index(bound.parameter) if bound.parameter in names else 0
    one = parameters[place]

    def value(size: float) -> float | None:
        theta = effect.sized(robot, bound.joint, bound.parameter, size, np.zeros(robot.nv))
        return None if theta is None else float(np.clip(theta[place], one.lower, one.upper))

    largest, slight = value(high), value(_SLIGHT * high)
    # A size that alone does not make an effect is the value of a parameter.
    if largest is None or slight is None:
        return UnseenRange(bound.parameter, bound.unit, low, high, 0.0)
    # Where the law has a pole, at nothing or at a size beyond what can be, the range is open as far as it makes sense.
    away = one.lower if largest > slight else one.upper
    absent, other = value(0.0), value(low)
    absent = away if absent is None else absent
    ends = largest, away if other is None else other
    return UnseenRange(one.name, one.unit, min(ends), max(ends), absent)


def found_range(randomisation: Randomisation, place: int) -> tuple[float, float]:
    """Two deviations to either side of one number, within its bounds."""
    low, high = _bounds(randomisation)
    value, half = randomisation.values[place], SIGMAS * randomisation.std[place]
    # What was found outside the bounds (less friction than modelled) stays what it is.
    return float(max(value - half, min(low[place], value))), float(min(value + half, max(high[place], value)))


def _bounds(randomisation: Randomisation) -> tuple[Array, Array]:
    """Bounds of all numbers as the effects state them."""
    low, high = [], []
    for effect in randomisation.found:
        parameters = effect_named(effect.effect, randomisation.robot).parameters(randomisation.robot, effect.joint)
        each = max(len(effect.theta) // len(parameters), 1)
        low += [p.lower for p in parameters for _ in range(each)][: len(effect.theta)]
        high += [p.upper for p in parameters for _ in range(each)][: len(effect.theta)]
    return np.array(low), np.array(high)


def _drawn(randomisation: Randomisation, values: Float[Array, " p"]) -> tuple[KnownEffect, ...]:
    low, high = _bounds(randomisation)
    mean = randomisation.values
    return randomisation.with_values(np.clip(values, np.minimum(low, mean), np.maximum(high, mean)))


def _hidden(
    randomisation: Randomisation, known: tuple[Bound, ...], rng: np.random.Generator, count: int
) -> tuple[KnownEffect, ...]:
    out = []
    for place in rng.choice(len(known), count, replace=False) if count else ():
        low, high = unseen_sizes(randomisation.robot, known[place])
        share = float(rng.uniform(low, high)) / known[place].below
        effect = unseen_effect(randomisation, known[place], share)
        out += [] if effect is None else [effect]
    return tuple(out)
