"""Tests whether the fitted size of an effect, such as the mass of a load, is plausible.

No robot that works has a size outside its plausible range. A finding of an implausible size is replaced by a rival of a
plausible size; without such a rival, the finding does not count for the verdict "explained". Each effect states the
ranges that hold for every robot. This module adds ranges relative to the recorded torque and speed of the joint. A size
is plausible if its uncertainty interval overlaps the range. For example, a slow motion hardly shows the mass of a load,
so the mass is uncertain.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identification.diagnosis.columns.session import Session
from identification.diagnosis.columns.terms import Term
from identification.diagnosis.search.containment import joints_of
from phantom_dyn.array_types import Array, Float
from phantom_dyn.effects.effect import Effect, Parameter

# A size is implausible if it is outside its range by more than this many of its standard deviations.
_DEVIATIONS = 2.0

# Upper end of the plausible range of friction: of dry friction in units of the largest recorded torque of the joint, of
# viscous friction in units of this torque over the largest recorded speed. For the reasons below, friction of more than
# one unit is implausible. Two units are allowed because the recorded torque may be half the true torque.
_FRICTION_LIMIT = 2.0
_TORQUE_REASON = (
    "a drive that moves a joint gives its friction at least, and this is more than twice the largest torque that was "
    "recorded"
)
_SPEED_REASON = (
    "a drive that moves a joint gives its friction at least, and at the largest speed this is more than twice the "
    "largest torque that was recorded"
)


def implausible_size(
    session: Session, term: Term, theta: Float[Array, " k"], cov: Float[Array, "k k"] | None = None
) -> tuple[Parameter, float] | None:
    """The first parameter of a fitted effect outside of its plausible range, and its value; None if all are inside.

    Args:
        session: The given model and the largest recorded torque and speed of each joint.
        term: An effect.
        theta: Coefficients of its columns.
        cov: Their covariance; None if the coefficients are exact.
    """
    if not isinstance(term.effect, Effect) or term.effect.inertial == "free":
        return None
    parameters = term.effect.parameters(session.robot, term.joint)
    values = _sizes(session, term, theta, len(parameters))
    margins = np.zeros_like(values) if cov is None else _DEVIATIONS * _deviations(session, term, theta, cov, values)
    for stated, own, margin in zip(parameters, values, margins, strict=True):
        parameter = _with_recorded_limit(session, term, stated)
        if parameter.plausible is None:
            continue
        low, high = parameter.plausible
        outside = own[(own + margin < low) | (own - margin > high)]
        if len(outside):
            return parameter, float(outside[0])
    return None


def rarity(session: Session, term: Term, theta: Float[Array, " k"], cov: Float[Array, "k k"]) -> float:
    """Rarity of the size of a fitted effect: minus two log likelihoods by a normal prior.

    Some effects are present in every device to a small extent, with either sign. Their prior has its mean at the
    stated value, and the ends of the plausible range are two standard deviations from it. All other effects have a
    rarity of zero, because all sizes in their range are equally likely.

    Args:
        session: The given model.
        term: An effect.
        theta: Coefficients of its columns.
        cov: Their covariance.
    """
    if not isinstance(term.effect, Effect):
        return 0.0
    parameters = term.effect.parameters(session.robot, term.joint)
    if not any(one.either_sign for one in parameters):
        return 0.0
    values, stated_values = (_sizes(session, term, at, len(parameters)) for at in (theta, np.zeros_like(theta)))
    deviations = _deviations(session, term, theta, cov, values)
    out = 0.0
    for parameter, own, stated, deviation in zip(parameters, values, stated_values, deviations, strict=True):
        if parameter.either_sign and parameter.plausible is not None:
            low, high = parameter.plausible
            # Standard deviation of the prior: half the distance from the stated value to the end of the range.
            prior_std = 0.5 * np.where(own < stated, stated - low, high - stated)
            out += float(np.sum((own - stated) ** 2 / (prior_std**2 + deviation**2)))
    return out


def _sizes(session: Session, term: Term, theta: Float[Array, " k"], count: int) -> Float[Array, "p n"]:
    """Sizes of an effect, one row for each of its parameters."""
    assert isinstance(term.effect, Effect)
    return np.reshape(term.effect.from_coefficients(session.robot, term.joint, theta, term.shape), (count, -1))


def _deviations(
    session: Session, term: Term, theta: Float[Array, " k"], cov: Float[Array, "k k"], values: Float[Array, "p n"]
) -> Float[Array, "p n"]:
    """Standard deviation of each size, from the changes of all sizes along each axis of the covariance."""
    squares, axes = np.linalg.eigh(cov)
    steps = (axes * np.sqrt(np.maximum(squares, 0.0))).T
    changed = [_sizes(session, term, theta + step, len(values)) - values for step in steps]
    return np.sqrt(np.sum(np.square(changed), axis=0))


def _with_recorded_limit(session: Session, term: Term, parameter: Parameter) -> Parameter:
    """The parameter with its plausible range limited by the recorded torque and speed of its joint."""
    rows = [session.robot.joint_names.index(one) for one in joints_of(term) if one in session.robot.joint_names]
    by_speed = parameter.unit in ("N m s/rad", "N s/m")
    of_friction = by_speed or (term.effect.rubs and parameter.unit in ("N m", "N"))
    if parameter.plausible is None or not rows or not of_friction:
        return parameter
    unit = session.largest_torque[rows] / (session.largest_speed[rows] if by_speed else 1.0)
    limit = _FRICTION_LIMIT * float(np.max(unit))
    low, high = parameter.plausible
    # A joint whose torque or speed was not recorded sets no limit.
    if not 0.0 < limit < high:
        return parameter
    return replace(parameter, plausible=(low, limit), plausible_because=_SPEED_REASON if by_speed else _TORQUE_REASON)
