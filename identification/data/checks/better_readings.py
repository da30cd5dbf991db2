"""Finds wrong units, signs and orders of columns in a recording: mistakes after whose correction the model fits.

A reading is the recording with one such correction. A mistake is certain if, in both halves of the recording, no
plausible robot explains the data as recorded, and a plausible robot explains the reading. Exchanged columns are also
certain if a robot has to be unlike its model to explain the data as recorded, while the model itself explains the
reading. The fits are those of `identification.data.checks.readings.plausible_fit`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from identification.data.checks.motor_positions import motor_side_suspects
from identification.data.checks.readings.model_explains import explained_by_the_model
from identification.data.checks.readings.plausible_fit import (
    ENOUGH,
    WITHOUT_LOAD,
    misfit_as_modelled,
    unexplained,
)
from identification.data.checks.readings.reading import Reading
from identification.data.checks.readings.reading_fits import (
    FAR_BETTER,
    WORSE,
    ReadingFit,
    explains_nearly_all,
    fit_of,
    is_certain,
    poorly_fitted,
)
from identification.data.checks.readings.suspects import (
    Suspect,
    all_signs,
    degree_suspects,
    length_suspects,
    order_suspects,
    sign_suspects,
    time_suspects,
    torque_suspects,
)
from identification.data.checks.readings.weights import attitude_suspects, compensated_suspects
from identification.data.checks.torques.scaled_model import common_ratio, plain_unexplained
from identification.data.checks.torques.torque_factors import factor_of_all, factor_suspects, unit_suspects
from identification.data.checks.torques.torque_scales import OTHER_UNIT
from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.dynamics.dynamics import inverse_dynamics, modelled_friction
from phantom_dyn.errors import ChainError
from phantom_dyn.model.robot import Robot

# Two readings fit equally well if their scores or misfits, which are sums of logarithms, differ by less than this
# number.
_EQUAL_FIT = 0.5
# A joint whose torque varies by less than this share of the modelled torque has no drive, or something else moves it.
_IDLE = 0.1
# Largest number of faults that are found one after the other.
_MOST_FAULTS = 3
# Two simultaneous mistakes are searched for if the unexplained share of a joint is at least this in both halves.
_FOR_TWO = 0.2
# Number of wrong signs that are tried as the first mistake of a pair, and number of pairs that are fitted in full.
_FIRSTS, _PAIRS = 6, 4
# Of degrees, signs, orders and gears of revolute joints, this number is fitted in full: those with the best quick fits.
_FITTED_IN_FULL = 6


def better_readings(robot: Robot, reading: Reading, step: float) -> list[ReadingFit]:
    """Certain mistakes, in the order in which they are found: each after those before it were corrected.

    Args:
        robot: The given model.
        reading: The data as recorded.
        step: Median time between two samples [s].
    """
    out: list[ReadingFit] = []
    for _ in range(_MOST_FAULTS):
        before = unexplained(robot, reading)
        units = [*time_suspects(robot, step), *length_suspects(robot, reading)]
        poor = poorly_fitted(before)
        if not poor and not any(suspect.expected for suspect in units):
            return out or explained_by_the_model(robot, reading)
        tried = [fit_of(robot, before, reading, suspect) for suspect in (*units, *_suspects(robot, reading, poor))]
        best = _best(robot, reading, before, tried)
        # If the data fit as recorded, no unit is wrong: the motion may really be so slow.
        after = _after_a_unit(robot, reading, step, _likely_units(tried, best)) if poor else []
        if after and (best is None or explains_nearly_all(after[-1])):
            return [*out, *after]
        if best is None:
            return out or explained_by_the_model(robot, reading)
        if best.suspect.parts:
            first, second = best.suspect.parts
            # Of equally good pairs with the same first mistake, the second mistakes are alternatives.
            twins = tuple(one.parts[1] for one in best.twins if one.parts[0] is first)
            return [*out, replace(best, suspect=first, twins=()), replace(best, suspect=second, twins=twins)]
        if best.suspect.outcome == "rival":
            # A diagnosis finds offsets of encoders only near the modelled zero, so another zero is reported here.
            other_zero = replace(best, suspect=replace(best.suspect, outcome="wrong"))
            return [*out, other_zero] if explains_nearly_all(best) else out
        out.append(best)
        if best.suspect.outcome == "offer":
            return out
        reading, step = _corrected(reading, step, best.suspect)
        robot = best.suspect.model or robot
    return out


def _best(
    robot: Robot, reading: Reading, before: Float[Array, "2 nv"], tried: Sequence[ReadingFit]
) -> ReadingFit | None:
    """The likeliest of the certain mistakes and pairs of mistakes; None if nothing is certain.

    Args:
        robot: The given model.
        reading: The data as recorded.
        before: Unexplained shares of the data as recorded, ``(2, nv)``.
        tried: Fits of readings that correct a single mistake.
    """
    certain = [one for one in tried if is_certain(one)]
    best = _likeliest(robot, reading, certain) if certain else None
    if best is None or best.suspect.price:
        # Fitted ratios can imitate two mistakes, such as a unit and a sign. So pairs of mistakes are tried as well.
        singles = [one for one in tried if not one.suspect.price]
        pairs = _pair_of_mistakes(robot, reading, before, singles)
        return _likeliest(robot, reading, [*certain, *pairs]) if pairs else best
    return best


def _corrected(reading: Reading, step: float, suspect: Suspect) -> tuple[Reading, float]:
    """The reading with a mistake corrected, and the corrected median time between two samples [s]."""
    corrected = suspect.read(reading)
    return corrected, step * float(np.ptp(corrected.motion.t) / np.ptp(reading.motion.t))


def _likely_units(tried: Sequence[ReadingFit], best: ReadingFit | None) -> list[ReadingFit]:
    """Corrections of units after which a second mistake is searched for: of units that are very likely wrong.

    If another mistake explains nearly all of the torque, only units of time are returned. They may still be wrong:
    positions in mm with a time in ms have accelerations of a thousandth, which look like another unit of torque.

    Args:
        tried: Fits of readings that correct a single mistake.
        best: The likeliest mistake that is certain; None without one.
    """
    units = [one for one in tried if one.suspect.expected]
    if best is None or not explains_nearly_all(best):
        return units
    return [] if best.suspect.expected else [one for one in units if one.suspect.kind == "time"]


def _after_a_unit(robot: Robot, reading: Reading, step: float, likely: Sequence[ReadingFit]) -> list[ReadingFit]:
    """The first likely unit after whose correction another mistake is certain, then the mistakes that follow it.

    The list is empty if there is no such unit.

    Args:
        robot: The given model.
        reading: The data as recorded.
        step: Median time between two samples [s].
        likely: Result of `_likely_units`.
    """
    for unit in likely:
        further = better_readings(robot, *_corrected(reading, step, unit.suspect))
        if any(one.suspect.outcome == "wrong" for one in further):
            return [unit, *further]
    return []


def _likeliest(robot: Robot, reading: Reading, certain: Sequence[ReadingFit]) -> ReadingFit:
    """The reading with the largest score; of readings with nearly equal scores, the one that fits the given model best.

    Scores alone do not decide: a plausible robot may have any offset, and torque constants of half to twice the stated
    ones. So a torque whose gravity part has the wrong sign may fit, or one with half the gear ratio.

    Args:
        robot: The given model.
        reading: The data as recorded.
        certain: Fits of readings whose mistake is certain; not empty.
    """
    best_score = max(one.score - FAR_BETTER * one.suspect.price for one in certain)
    tied = [one for one in certain if one.score > best_score - _EQUAL_FIT]
    # A rival, such as another zero, is compared only with an attitude of the base, or if it is the first in the list.
    if tied[0].suspect.kind != "attitude" and tied[0].suspect.outcome != "rival":
        tied = [one for one in tied if one.suspect.outcome != "rival"]
    if len(tied) == 1:
        return tied[0]
    costs = [
        misfit_as_modelled(one.suspect.model or robot, one.suspect.read(reading)) + FAR_BETTER * one.suspect.price
        for one in tied
    ]
    least = min(costs)
    # The first of them is taken: wrong signs of torques are more frequent than, and listed before, those of positions.
    # Fitted numbers come last, although they may fit a little better.
    equal = [one for cost, one in zip(costs, tied, strict=True) if cost <= least + _EQUAL_FIT]
    equal.sort(key=lambda one: one.suspect.price)
    if len(equal) > 1 and equal[0].suspect.kind in ("sign", "pair"):
        # With a load that mirrors the last link, a wrong sign of the torque and a reversed position fit equally well.
        # So a reading that needs no load is preferred.
        equal = [one for one in equal if not _needs_load(robot, one.suspect.read(reading))] or equal
    best = equal[0].suspect
    if best.kind == "attitude":
        # The first direction of gravity is the simplest. Another zero of the first joint has the same effect, and is
        # given as a twin.
        return replace(equal[0], twins=tuple(one.suspect for one in equal[1:] if one.suspect.outcome == "rival"))
    twins = [one.suspect for one in equal[1:] if one.suspect.joints == best.joints or one.suspect.kind == "length"]
    return replace(equal[0], twins=tuple(one for one in twins if one.kind == best.kind and one.outcome == "wrong"))


def _needs_load(robot: Robot, reading: Reading) -> bool:
    """Whether a robot like its model explains a reading far better with a payload than without one."""
    return misfit_as_modelled(robot, reading, WITHOUT_LOAD) > misfit_as_modelled(robot, reading) + FAR_BETTER


def _pair_of_mistakes(
    robot: Robot, reading: Reading, before: Float[Array, "2 nv"], singles: Sequence[ReadingFit]
) -> list[ReadingFit]:
    """Pairs of mistakes that are certain together, but not each by itself.

    Args:
        robot: The given model.
        reading: The data as recorded.
        before: Unexplained shares of the data as recorded, ``(2, nv)``.
        singles: Fits of readings that correct a single mistake.
    """
    smaller = np.nanmin(before, axis=0, initial=np.inf, where=~np.isnan(before))
    if not (smaller[np.isfinite(smaller)] >= _FOR_TWO).any():
        return []
    as_recorded = plain_unexplained(robot, reading)
    firsts = [
        *degree_suspects(robot, reading),
        *length_suspects(robot, reading),
        *_best_in_quick_fit(robot, reading, as_recorded, _signs(robot, reading), _FIRSTS),
    ]
    pairs: list[tuple[float, Suspect, Suspect]] = []
    for first in firsts:
        try:
            corrected = first.read(reading)
            ratio = common_ratio(robot, corrected)
            signs = _signs(robot, corrected)
            seconds = [*torque_suspects(robot, ratio), *all_signs(robot), *signs]
            if first.kind in ("degrees", "length"):
                seconds += order_suspects(robot, range(robot.nv))
            if ratio is not None and abs(np.log(ratio)) > OTHER_UNIT:
                seconds.append(factor_of_all(robot, 1 / ratio))
            # Two signs of the same joint are one mistake, which is tried by itself.
            seconds = [one for one in seconds if not (one.kind == "sign" and one.joints == first.joints)]
            pairs += [(_quick_gain(robot, as_recorded, second.read(corrected)), first, second) for second in seconds]
        except ChainError:
            continue
    pairs.sort(key=lambda pair: -pair[0])
    single = max((one.score for one in singles), default=0.0)
    out: list[ReadingFit] = []
    for _, first, second in pairs[:_PAIRS]:
        both = fit_of(robot, before, reading, second.after(first))
        if not is_certain(both) or both.score <= single + FAR_BETTER:
            continue
        # Both corrections have to be necessary.
        parts = [fit_of(robot, before, reading, one).score for one in (first, second)]
        if both.score > max(parts) + FAR_BETTER:
            out.append(both)
    return out


def _signs(robot: Robot, reading: Reading) -> list[Suspect]:
    """The suspected wrong signs of all joints with a drive."""
    driven = np.flatnonzero(_driven(robot, reading)).tolist()
    return [one for one in sign_suspects(robot, driven) if one.outcome == "wrong"]


def _quick_gain(robot: Robot, as_recorded: Float[Array, " nv"], corrected: Reading) -> float:
    """Gain of a reading, summed over all joints: the logarithm of the ratio of unexplained shares, by quick fits.

    Args:
        robot: The given model.
        as_recorded: Unexplained share of each joint with the data as recorded.
        corrected: The data with a suspected mistake corrected.
    """
    return float(np.nansum(np.log((as_recorded + ENOUGH) / (plain_unexplained(robot, corrected) + ENOUGH))))


def _best_in_quick_fit(
    robot: Robot, reading: Reading, as_recorded: Float[Array, " nv"], suspects: Sequence[Suspect], count: int
) -> list[Suspect]:
    """The ``count`` mistakes whose correction gains most in quick fits of all joints."""
    gains = [_quick_gain(robot, as_recorded, suspect.read(reading)) for suspect in suspects]
    return [suspects[k] for k in np.argsort(gains)[::-1][:count]]


def _suspects(robot: Robot, reading: Reading, poor: Sequence[int]) -> list[Suspect]:
    """All suspected mistakes, except units of time and length.

    Args:
        robot: The given model.
        reading: The data as recorded.
        poor: Joints that fit poorly.
    """
    if not poor:
        return []
    driven = _driven(robot, reading)
    signed = [j for j in poor if driven[j]]
    ratio = common_ratio(robot, reading)
    motors = motor_side_suspects(robot, reading)
    quickly_fitted_first = [
        *degree_suspects(robot, reading),
        *(one for one in motors if one.turned),
        *(all_signs(robot) if signed == list(poor) else ()),
        *sign_suspects(robot, signed),
        *order_suspects(robot, signed),
    ]
    return [
        *(one for one in motors if not one.turned),
        *_units_closer_in_size(robot, reading, torque_suspects(robot, ratio)),
        *unit_suspects(robot, reading),
        *factor_suspects(robot, reading),
        *compensated_suspects(robot, reading),
        *attitude_suspects(robot, reading),
        *_better_in_quick_fit(robot, reading, quickly_fitted_first),
    ]


def _units_closer_in_size(robot: Robot, reading: Reading, suspects: Sequence[Suspect]) -> list[Suspect]:
    """The units with which the torques are closer in size to the modelled torques than as recorded."""
    needed = _needed(robot, reading).std(axis=0)

    def distance(tau: Float[Array, "N nv"]) -> float:
        """Absolute median logarithm of the ratio of torque to modelled torque, by standard deviations."""
        size = (tau + reading.external).std(axis=0)
        known = (needed > 0) & (size > 0)
        return abs(float(np.median(np.log(size[known] / needed[known])))) if known.any() else np.inf

    as_recorded = distance(reading.tau)
    return [one for one in suspects if distance(one.read(reading).tau) < as_recorded]


def _driven(robot: Robot, reading: Reading) -> Bool[Array, " nv"]:
    """True for joints whose torque is large enough to move them; False without a drive, or if something else does."""
    return reading.tau.std(axis=0) >= _IDLE * _needed(robot, reading).std(axis=0)


def _needed(robot: Robot, reading: Reading) -> Float[Array, "N nv"]:
    """Torque of the model without friction."""
    return inverse_dynamics(robot, reading.motion) - modelled_friction(robot, reading.motion)


def _better_in_quick_fit(robot: Robot, reading: Reading, suspects: Sequence[Suspect]) -> list[Suspect]:
    """The mistakes whose correction clearly improves a quick fit, at most the `_FITTED_IN_FULL` best."""
    before = plain_unexplained(robot, reading)
    gains = np.full(len(suspects), -np.inf)
    for k, suspect in enumerate(suspects):
        joints = list(range(robot.nv)) if suspect.moves else list(suspect.joints)
        try:
            after = plain_unexplained(robot, suspect.read(reading))
        except ChainError:
            continue
        gains[k] = float(np.nansum(np.log((before[joints] + ENOUGH) / (after[joints] + ENOUGH))))
    best = np.argsort(gains)[::-1][:_FITTED_IN_FULL]
    return [suspects[k] for k in sorted(best.tolist()) if gains[k] > WORSE]
