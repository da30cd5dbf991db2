"""Joints whose held-out torque an identification misses, and what acts on two joints at once where that would mend it.

The terms of an identification act on one joint each. Where two joints share a transmission, friction moves with both:
every effect of the catalogue that acts on pairs is fitted beside the terms, chosen on the data of the fit, and named
only if it halves the error on held-out data.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from identification.estimators.fit import Fit
from identification.estimators.weighted_least_squares import wls
from identification.identify.hold_out import Split
from identification.identify.identification import JointError
from identification.identify.identification_words import error_percent
from identification.regression.regressor import EffectOnJoint, Regressor, torque_regressor
from phantom_dyn.array_types import Array, Float
from phantom_dyn.effects.catalogue import effects_of
from phantom_dyn.effects.effect import Effect
from phantom_dyn.effects.operation import Operation
from phantom_dyn.errors import EstimationError, IdentifiabilityError, listed
from phantom_dyn.model.robot import Robot

MISSED = 0.3
"""Relative error on held-out data above which a joint's parameters are not to be relied on."""

# An effect is named where it leaves at most this share of the error of one of its joints that is missed ...
_MENDS = 0.5
# ... and no error is larger than it was by this factor: chance moves those of joints that it does not act on.
_HARMS = 1.5
# Joints that are looked at, the worst first: each is fitted with several others.
_MOST = 4


@dataclass(frozen=True)
class Shared:
    """An effect on two joints that would mend an identification.

    Attributes:
        effect: Of the catalogue.
        joints: The two.
        errors: Relative error of each on held-out data, with the effect.
    """

    effect: Effect
    joints: tuple[str, str]
    errors: tuple[float, float]


def missed(joints: Sequence[JointError]) -> tuple[JointError, ...]:
    """Joints whose held-out torque is missed by more than 30 %, the worst first."""
    return tuple(sorted((joint for joint in joints if joint.relative > MISSED), key=lambda joint: -joint.relative))


def shared_effects(
    robot: Robot, split: Split, effects: Sequence[EffectOnJoint], joints: Sequence[JointError]
) -> tuple[Shared, ...]:
    """Effects on two joints that halve the held-out error of a joint that is missed, each joint named once.

    Args:
        robot: The one that was fitted, without the friction and rotors that were unknowns.
        split: What is fitted and judged on.
        effects: What was fitted.
        joints: Errors of every joint.
    """
    worst = [joint.joint for joint in missed(joints)[:_MOST]]
    if not worst:
        return ()
    before = np.array([joint.relative for joint in joints])
    out: list[Shared] = []
    for one in sorted(_tried(robot, split, effects, worst), key=lambda one: one.score)[:_MOST]:
        if any(joint in other.joints for joint in one.joints for other in out):
            continue
        errors = _held_out(robot, split, one.fit)
        rows = [robot.joint_names.index(joint) for joint in one.joints]
        mends = any(errors[j] <= _MENDS * before[j] for j in rows if robot.joint_names[j] in worst)
        if mends and not np.any(errors > _HARMS * before):
            out.append(Shared(one.effect, one.joints, (float(errors[rows[0]]), float(errors[rows[1]]))))
    return tuple(out)


@dataclass(frozen=True)
class _Tried:
    """One effect on two joints beside the terms, and how well it fits: smaller is better."""

    effect: Effect
    joints: tuple[str, str]
    fit: Fit
    score: float


def _tried(robot: Robot, split: Split, effects: Sequence[EffectOnJoint], worst: Sequence[str]) -> list[_Tried]:
    """The best shape of every effect on every pair with one of the worst joints."""
    operation = Operation.of(robot, split.train[0].motion, split.train[0].tau)
    out = []
    for effect in effects_of(robot):
        for place in effect.places(robot) if effect.scope == "pair" else ():
            first, _, second = (place or "").partition("+")
            if {first, second} & set(worst) and effect.untestable(robot, operation, place) is None:
                shapes = effect.shapes(robot, operation, place)
                fits = [_fit(robot, split, (*effects, (effect, place, shape))) for shape in shapes]
                found = [_Tried(effect, (first, second), fit, _score(fit)) for fit in fits if fit is not None]
                out += sorted(found, key=lambda one: one.score)[:1]
    return out


def _fit(robot: Robot, split: Split, effects: Sequence[EffectOnJoint]) -> Fit | None:
    """Weighted least squares; None where it fails."""
    try:
        return wls(torque_regressor(robot, split.train, effects))
    except (EstimationError, IdentifiabilityError):
        return None


def _score(fit: Fit) -> float:
    """Sum of the logarithms of a fit's relative errors, in which every joint counts alike."""
    return float(np.nansum(np.log(np.maximum(fit.relative_error, 1e-9))))


def _held_out(robot: Robot, split: Split, fit: Fit) -> Float[Array, " nv"]:
    """Relative error of each joint on held-out data, NaN without torque."""
    measured = np.concatenate([Regressor.in_band(log, log.tau) for log in split.test])
    left = measured - np.concatenate([Regressor.in_band(log, fit.predict(robot, log.motion)) for log in split.test])
    size = np.sqrt(np.mean(measured**2, axis=0))
    return np.divide(np.sqrt(np.mean(left**2, axis=0)), size, out=np.full(robot.nv, np.nan), where=size > 0)


def missed_sentences(joints: Sequence[JointError], shared: Sequence[Shared]) -> tuple[str, ...]:
    """What to tell of joints whose held-out torque is missed; nothing where there are none.

    Args:
        joints: Errors of every joint.
        shared: What would mend them.
    """
    poor = missed(joints)
    if not poor:
        return ()
    named = listed([f"{joint.joint} ({error_percent(joint.relative)})" for joint in poor])
    out = [
        f"The torque error on held-out data is above {100 * MISSED:.0f} % on {named}: rely on neither the parameters "
        "nor the model files there before the cause is found; phantom-dyn diagnose looks for it."
    ]
    for one in shared:
        first, second = one.joints
        errors = " and ".join(error_percent(error) for error in one.errors)
        out.append(
            f"Friction moves with both {first} and {second}: {one.effect.words.name} ({one.effect.words.meaning}) "
            f"would lower their errors to {errors}, and no parameter here stands for it; phantom-dyn diagnose measures "
            "it."
        )
    return tuple(out)
