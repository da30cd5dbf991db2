"""Checks an effect that a user defined: computes its law and its columns on a short motion before any fit.

An error in the effect is then reported in one sentence, before it causes an exception or a wrong size in a diagnosis.
"""

from __future__ import annotations

import re
import string
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from phantom_dyn.array_types import Array, Float
from phantom_dyn.effects.described import EffectWords
from phantom_dyn.effects.effect import Effect, Parameter
from phantom_dyn.effects.law_effect import LawEffect, at_moment, rows_of_law, unit_of
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.rival import Shape, Signature
from phantom_dyn.effects.simulated import Moment, Simulated
from phantom_dyn.errors import EffectError, PhantomDynError
from phantom_dyn.model.robot import Robot, position_limits
from phantom_dyn.motion import Motion

R = TypeVar("R")

REGIMES = (
    "velocity_reversal",
    "low_speed",
    "high_speed",
    "high_load",
    "high_acceleration",
    "one_direction",
    "periodic_in_angle",
    "posture",
    "saturated",
    "time_drift",
    "everywhere",
)
"""Parts of the motion in which an effect can be largest."""

_NAME = re.compile(r"[a-z][a-z0-9_]*")
_SAMPLES, _SECONDS = 64, 2.0
# Half the range of the motion [rad or m]: of a revolute joint, of a prismatic joint, and of any joint in a closed
# chain, whose loops may not close in a larger range.
_TURN, _SLIDE, _CHAIN = 0.5, 0.1, 0.05
# Tolerance of each condition on a law, as a share of the largest torque; it allows for rounding errors.
_ROUNDING = 1e-6


def tried(effect: Effect, robot: Robot, origin: str) -> Effect:
    """The effect, if a diagnosis of this robot can use it.

    Args:
        effect: The effect of a user.
        robot: The robot that the effect is for.
        origin: File and class of the effect, with which messages begin: ``my_effects.py: class QuadraticDrag``.

    Raises:
        EffectError: If something is wrong with the effect; the message says what to do.
    """
    _require_description(effect, origin)
    operation = trial_motion(robot)
    for joint in _result_of(origin, "places", lambda: effect.places(robot)):
        theta, known = _parameters(effect, robot, joint, origin)
        _require_words(effect, known, origin)
        if isinstance(effect, LawEffect) and type(effect).signature is LawEffect.signature:
            _require_law(effect, robot, operation, joint, origin)
        else:
            _torque(effect, robot, operation, joint, theta, origin)
            _require_columns(effect, robot, operation, joint, origin)
        made = _result_of(origin, "simulated", lambda at=joint, x=theta: effect.simulated(robot, at, x))
        if not isinstance(made, Simulated):
            raise EffectError(f"{origin}: simulated gave {_kind(made)}, wanted a Simulated: return one.")
    return effect


def trial_motion(robot: Robot) -> Operation:
    """Two seconds of a sine on each joint, within its limits and with its own frequency, with the model's torque."""
    lower, upper = position_limits(robot)
    bounded = np.isfinite(lower) & np.isfinite(upper)
    middle = np.where(bounded, 0.5 * (np.where(bounded, lower, 0.0) + np.where(bounded, upper, 0.0)), 0.0)
    half = np.where(robot.prismatic, _SLIDE, _TURN)
    half = np.minimum(half, np.where(bounded, 0.4 * (upper - lower), np.inf))
    if robot.chain is not None:
        middle, half = np.zeros(robot.nv), np.full(robot.nv, _CHAIN)
    t = np.arange(_SAMPLES) * _SECONDS / _SAMPLES
    w = 2.0 * np.pi * (0.7 + 0.13 * np.arange(robot.nv))
    angle = w * t[:, None] + 0.3
    motion = Motion(t, middle + half * np.sin(angle), half * w * np.cos(angle), -half * w**2 * np.sin(angle))
    return Operation.of(robot, motion)


def _require_description(effect: Effect, origin: str) -> None:
    """Check name, regime and words."""
    name = getattr(effect, "name", None)
    if not isinstance(name, str) or not _NAME.fullmatch(name):
        raise EffectError(
            f"{origin} has {'no name' if name is None else f'the name {name!r}'}, wanted one of small letters, digits "
            'and underscores: give it, as in name = "belt_slip".'
        )
    regime = getattr(effect, "regime", None)
    if regime not in REGIMES:
        raise EffectError(f"{origin} has the regime {regime!r}, wanted one of {', '.join(REGIMES)}: give regime.")
    words = getattr(effect, "words", None)
    if not isinstance(words, EffectWords):
        raise EffectError(
            f"{origin} has {_kind(words)} as words, wanted EffectWords(name, meaning, next_step): give it."
        )


def _require_words(effect: Effect, known: tuple[Parameter, ...], origin: str) -> None:
    """Check that ``words.size`` names parameters of the effect."""
    names = [one.name for one in known]
    fields = [name for _, name, _, _ in string.Formatter().parse(effect.words.size) if name is not None]
    for name in fields:
        if name not in names:
            raise EffectError(
                f"{origin}: words.size names {{{name}}}, wanted one of its parameters {', '.join(names)}: correct it."
            )


def _parameters(
    effect: Effect, robot: Robot, joint: str | None, origin: str
) -> tuple[Float[Array, " p"], tuple[Parameter, ...]]:
    """Checked parameters of the effect: an allowed value of each, and the parameters themselves."""
    known = _result_of(origin, "parameters", lambda: effect.parameters(robot, joint))
    if not isinstance(known, tuple) or not known or not all(isinstance(one, Parameter) for one in known):
        raise EffectError(f"{origin}: parameters gave {_kind(known)}, wanted a tuple of Parameter: return one.")
    names = [one.name for one in known]
    if len(set(names)) < len(names):
        raise EffectError(f"{origin} has parameters {', '.join(names)}, wanted each name once: rename one.")
    for one in known:
        if not one.lower < one.upper:
            raise EffectError(
                f"{origin}: {one.name} may be from {one.lower:g} to {one.upper:g}, wanted lower below upper: "
                "correct them."
            )
        if one.plausible is not None and not one.lower <= one.plausible[0] < one.plausible[1] <= one.upper:
            low, high = one.plausible
            raise EffectError(
                f"{origin}: {one.name} is plausible from {low:g} to {high:g}, wanted a range within what is possible, "
                f"{one.lower:g} to {one.upper:g}: correct one of them."
            )
    return np.array([unit_of(one) for one in known]), known


def _require_law(effect: LawEffect, robot: Robot, operation: Operation, joint: str | None, origin: str) -> None:
    """Check that a law is zero for zero parameters, linear, on its joint only, and consistent with its attributes."""
    known = effect.parameters(robot, joint)
    shape = _first_shape(known, origin)
    linear = [one for one in known if not one.tried]
    steps = np.array([unit_of(one) for one in linear])

    def law(coefficients: Array, on: Operation = operation) -> Array:
        theta = effect.from_coefficients(robot, joint, coefficients, shape)
        return _torque(effect, robot, on, joint, theta, origin)

    whole = law(steps)
    least = _ROUNDING * max(float(np.abs(whole).max()), 1e-300)
    if np.abs(law(np.zeros(len(steps)))).max() > least:
        raise EffectError(
            f"{origin}: its torque is not zero where {', '.join(one.name for one in linear)} "
            f"{'is' if len(linear) == 1 else 'are'} zero, which should mean that the effect is absent: give a "
            "parameter that it is not linear in values to try, as in Parameter(..., tried=(0.1, 0.3))."
        )
    _require_linear(linear, steps, law, least, origin)
    others = [row for row in range(robot.nv) if row not in rows_of_law(robot, joint)]
    if np.abs(whole[:, others]).max(initial=0.0) > least:
        raise EffectError(
            f"{origin}: its torque on {joint} acts on other joints too, wanted zero there: set scope to robot, or give "
            "signature as well."
        )
    _require_stated_inputs(effect, operation, lambda on: law(steps, on), least, origin)
    if type(effect).simulated is LawEffect.simulated:
        _require_momentary(operation, lambda on: law(steps, on), whole, least, origin)


def _require_momentary(
    operation: Operation, law: Callable[[Operation], Array], whole: Array, least: float, origin: str
) -> None:
    """Check that the torque of a sample depends on this sample only, because a simulation has no other samples."""
    samples = range(0, _SAMPLES, 7)
    try:
        alone = np.concatenate([law(at_moment(operation.robot, _moment(operation, k))) for k in samples])
    except EffectError:
        alone = np.full((len(samples), whole.shape[1]), np.inf)
    if np.abs(alone - whole[list(samples)]).max() > least:
        raise EffectError(
            f"{origin}: its torque at a sample needs the acceleration or other samples, which no simulation has at "
            "that moment: use q, v and transmitted of the sample alone, or give simulated as well."
        )


def _require_linear(
    linear: list[Parameter], steps: Array, law: Callable[[Array], Array], least: float, origin: str
) -> None:
    """Check that the torque is linear in each parameter, and that the torques of all parameters add up."""
    for k, one in enumerate(linear):
        none, half = steps.copy(), steps.copy()
        none[k], half[k] = 0.0, 0.5 * steps[k]
        if np.abs(law(steps) + law(none) - 2.0 * law(half)).max() > least:
            raise EffectError(
                f"{origin}: its torque is not linear in {one.name}: give that one values to try, as in "
                f'Parameter("{one.name}", "{one.unit}", tried=(0.1, 0.3, 1.0)).'
            )
    alone = sum(law(np.where(np.arange(len(steps)) == k, steps, 0.0)) for k in range(len(steps)))
    if np.abs(law(steps) - alone).max() > least:
        names = ", ".join(one.name for one in linear)
        raise EffectError(
            f"{origin}: its torque is no sum over {names}, as one multiplies another: give one of them values "
            f'to try, as in Parameter("{linear[-1].name}", "{linear[-1].unit}", tried=(0.1, 0.3, 1.0)).'
        )


def _require_stated_inputs(
    effect: LawEffect, operation: Operation, law: Callable[[Operation], Array], least: float, origin: str
) -> None:
    """Check that ``made_of`` names accelerations and the model's torque if the law uses them.

    Both have errors (noise, and errors of the model) that the diagnosis takes into account. The law uses an input if
    its torque changes when the input is scaled by 1.1.
    """
    if effect.follows_model or effect.follows_torque:
        return

    def depends_on(a: float = 1.0, tau: float = 1.0) -> bool:
        """Whether the torque of the law changes if acceleration and modelled torque are scaled by these factors."""
        torque = tau * operation.tau
        motion = operation.t, operation.q, operation.v, a * operation.a
        scaled = Operation(*motion, operation.robot, torque, torque, torque)
        return bool(np.abs(law(scaled) - law(operation)).max() > least)

    if depends_on(tau=1.1):
        raise EffectError(f"{origin}: its torque follows that of the model: add 'model' to made_of.")
    if not effect.uses_acceleration and depends_on(a=1.1):
        raise EffectError(
            f"{origin}: its torque uses accelerations, which are noisy: add 'acceleration' to made_of, or use "
            "a velocity."
        )


def _first_shape(known: tuple[Parameter, ...], origin: str) -> Shape:
    """The first tried value of each parameter in which the law is not linear."""
    for one in known:
        if not all(np.isfinite(x) and x != 0 and one.lower <= x <= one.upper for x in one.tried):
            raise EffectError(
                f"{origin}: {one.name} is to be tried at {one.tried}, wanted possible numbers other than zero: "
                "correct them."
            )
    if all(one.tried for one in known):
        raise EffectError(
            f"{origin} is linear in none of its parameters {', '.join(one.name for one in known)}: write the law with "
            "a factor that says how much of the effect there is, and give that one no values to try."
        )
    return tuple(one.tried[0] for one in known if one.tried)


def _require_columns(effect: Effect, robot: Robot, operation: Operation, joint: str | None, origin: str) -> None:
    """Check that columns that a user defined are minus the torque of the law per coefficient."""
    shapes = _result_of(origin, "shapes", lambda: effect.shapes(robot, operation, joint))
    # Without shapes this motion cannot show the effect, such as a wave that needs several periods.
    if not shapes:
        return
    shape = shapes[0]
    made = _result_of(origin, "signature", lambda: effect.signature(robot, operation, joint, shape))
    if not isinstance(made, Signature):
        raise EffectError(f"{origin}: signature gave {_kind(made)}, wanted a Signature: return one.")
    wanted = (_SAMPLES, len(made.rows), len(made.names))
    if made.columns.shape != wanted or not np.isfinite(made.columns).all():
        what = f"shape {made.columns.shape}" if made.columns.shape != wanted else "values that are not finite"
        raise EffectError(f"{origin}: signature gave columns of {what}, wanted {wanted} finite numbers.")
    # Columns of such effects are an expansion, a secant or a part of the law, which cannot be compared with the law.
    if (
        not made.names
        or effect.first_order
        or effect.shape_is_estimate
        or effect.seen_by == "neither"
        or effect.inertial
    ):
        return
    ones = np.ones(len(made.names))
    theta = _result_of(origin, "from_coefficients", lambda: effect.from_coefficients(robot, joint, ones, shape))
    torque = _torque(effect, robot, operation, joint, theta, origin)[:, list(made.rows)]
    given = made.columns @ ones
    if np.abs(torque + given).max() > _ROUNDING * np.abs(given).max():
        raise EffectError(
            f"{origin}: signature and torque are of different laws on {joint or 'the robot'}, wanted columns "
            "@ coefficients = -torque: correct one of them, or leave signature out of a LawEffect."
        )


def _torque(effect: Effect, robot: Robot, operation: Operation, joint: str | None, theta: Array, origin: str) -> Array:
    """Torque of the law, checked to be a finite number for every sample and joint."""
    torque: Any = _result_of(origin, "torque", lambda: effect.torque(robot, operation, joint, theta))
    wanted = (len(operation.t), robot.nv)
    if not isinstance(torque, np.ndarray) or torque.shape != wanted:
        given = f"shape {torque.shape}" if isinstance(torque, np.ndarray) else _kind(torque)
        raise EffectError(
            f"{origin}: torque gave {given}, wanted an array of shape {wanted}, a row a sample and a column a joint: "
            "torque_on_joint(robot, joint, values) makes one."
        )
    if not np.isfinite(torque).all():
        sizes = ", ".join(f"{x:g}" for x in theta)
        raise EffectError(
            f"{origin}: torque gave values that are not finite on {joint or 'the robot'} for parameters {sizes}: give "
            "a number at every position and velocity, and a parameter that the torque is not linear in values to try, "
            "as in Parameter(..., tried=(0.1, 0.3))."
        )
    return torque


def _moment(operation: Operation, sample: int) -> Moment:
    return Moment(float(operation.t[sample]), operation.q[sample], operation.v[sample], operation.transmitted[sample])


def _result_of(origin: str, method: str, call: Callable[[], R]) -> R:
    """Result of a method that a user defined; the message of an error names the method."""
    try:
        return call()
    except PhantomDynError as error:
        raise EffectError(f"{origin}: {method} raised {error}") from error
    except Exception as error:
        raise EffectError(f"{origin}: {method} raised {type(error).__name__}: {error}; correct it.") from error


def _kind(given: object) -> str:
    """Type of a value in words, for messages."""
    return "nothing" if given is None else f"a {type(given).__name__}"
