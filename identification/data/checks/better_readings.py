"""Finds mistakes in a recording: another unit, sign or order of columns with which the model fits far better.

A reading is the recording with one such correction. A mistake is certain if no plausible robot explains the data as
recorded, and a plausible robot explains the reading, in both halves of the recording. The fits are those of
`identification.data.checks.readings.plausible_fit`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from identification.data.checks.motor_positions import motor_side_suspects
from identification.data.checks.readings import suspects as other
from identification.data.checks.readings.plausible_fit import (
    AS_MODELLED,
    ENOUGH,
    PLAUSIBLE,
    Freedom,
    misfit_as_modelled,
    unexplained,
)
from identification.data.checks.readings.reading import Reading
from identification.data.checks.readings.suspects import Suspect
from identification.data.checks.readings.weights import attitude_suspects, compensated_suspects
from identification.data.checks.torques.scaled_model import common_ratio, plain_unexplained
from identification.data.checks.torques.torque_factors import factor_of_all, factor_suspects, unit_suspects
from identification.data.checks.torques.torque_scales import OTHER_UNIT
from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.dynamics.dynamics import inverse_dynamics, modelled_friction
from phantom_dyn.errors import ChainError
from phantom_dyn.model.robot import Robot

# A reading is far better if the unexplained share of the torque's variance falls to a quarter (geometric mean over both
# halves of the recording), and to a half or less in each half.
_FAR_BETTER, _EITHER_HALF = float(np.log(4.0)), float(np.log(2.0))
# Logarithm of the largest acceptable increase of the unexplained share of any joint.
_WORSE = float(np.log(1.5))
# Largest unexplained share with the correct reading.
_RIGHT = 0.15
# Difference of the summed gains of two readings below which they fit equally well.
_EQUAL_FIT = 0.5
# Share of the needed torque below which a joint has no drive, or is moved by something else.
_IDLE = 0.1
# Largest number of faults that are found one after the other.
_MOST_FAULTS = 3
# Two simultaneous mistakes are looked for from the first unexplained share on; with both corrected, the median share
# may be at most the second.
_FOR_TWO, _BOTH_RIGHT = 0.2, 0.1
# Number of signs that are tried as the first mistake of a pair, and number of pairs that are fitted in full.
_FIRSTS, _PAIRS = 6, 4
# Number of the best signs and orders by a quick fit that are fitted in full.
_FITTED_IN_FULL = 6


@dataclass(frozen=True)
class ReadingFit:
    """Fit of a reading, compared with the fit of the data as recorded.

    Attributes:
        suspect: The mistake that the reading corrects.
        gains: Logarithm of the unexplained share as recorded over that of the reading, by half of the recording and
            joint, ``(2, nv)``.
        unexplained: Unexplained share of the reading, ``(2, nv)``.
        twins: Other mistakes that the data do not distinguish from it.
    """

    suspect: Suspect
    gains: Float[Array, "2 nv"]
    unexplained: Float[Array, "2 nv"]
    twins: tuple[Suspect, ...] = ()

    @property
    def joint_gains(self) -> Float[Array, " nv"]:
        """Gain of each joint over both halves, see `_joint_gains`."""
        return _joint_gains(self.gains)

    @property
    def score(self) -> float:
        """Sum of the gains of all joints."""
        return float(np.nansum(self.joint_gains))


def _joint_gains(gains: Float[Array, "2 nv"]) -> Float[Array, " nv"]:
    """Gain of each joint: the mean of both halves if both are large, else the smaller one; NaN if both are NaN."""
    known = ~np.isnan(gains).all(axis=0)
    out = np.full(gains.shape[1], np.nan)
    smaller = np.nanmin(gains[:, known], axis=0)
    out[known] = np.where(smaller >= _EITHER_HALF, np.nanmean(gains[:, known], axis=0), smaller)
    return out


def fit_of(
    robot: Robot,
    before: Float[Array, "2 nv"],
    reading: Reading,
    suspect: Suspect,
    freedom: Freedom = PLAUSIBLE,
) -> ReadingFit:
    """Fit of the reading that corrects a suspected mistake.

    Args:
        robot: The given model.
        before: Unexplained shares of the data as recorded.
        reading: The data as recorded.
        suspect: The suspected mistake.
        freedom: How far the robot may be from its model.
    """
    corrected = suspect.read(reading)
    try:
        shares = unexplained(suspect.model or robot, corrected, freedom)
    except ChainError:
        # With this reading the loops of a closed chain do not close: it cannot be correct.
        shares = np.full_like(before, np.inf)
    if suspect.kind == "gravity":
        # This reading adds a torque of the model, which raises the variance. The share stays that of the measured one.
        shares = shares * corrected.tau.var(axis=0) / np.maximum(reading.tau.var(axis=0), 1e-300)
    return ReadingFit(suspect, np.log((before + ENOUGH) / (shares + ENOUGH)), shares)


def is_certain(found: ReadingFit) -> bool:
    """Whether a reading fits far better on the joints that it changes, and no other joint fits worse."""
    gains, joints = found.joint_gains, list(found.suspect.joints)
    gains_of_joints = gains[joints]
    if np.nanmin(gains, initial=0.0) < -_WORSE:
        return False
    if found.suspect.expected:
        shares = found.unexplained[~np.isnan(found.unexplained)]
        return float(np.nansum(gains)) >= 0 and len(shares) > 0 and float(np.median(shares)) <= _RIGHT
    worst = np.array([np.nanmax(column) if not np.isnan(column).all() else np.nan for column in found.unexplained.T])
    improved = (gains_of_joints >= _FAR_BETTER) & (worst[joints] <= _RIGHT)
    if found.suspect.kind == "order":
        return bool(improved.any() and np.all(gains_of_joints >= _WORSE))
    # One improved joint is enough in five cases: the mistake is only mentioned, not reported as a fault (`offer`); the
    # recorded travel is impossible (`length`); each factor is that of a drive, as no load would make it (`factors`);
    # the torque grows with speed as only a back-EMF does (`voltage`); a joint turns more than once only if its position
    # is in degrees (`degrees`).
    if found.suspect.outcome == "offer" or found.suspect.kind in ("length", "factors", "voltage"):
        return bool(improved.any())
    if found.suspect.kind == "degrees" and found.suspect.turned:
        return bool(improved.any())
    if found.suspect.kind == "attitude":
        # All joints have the same gravity. A load that the model lacks may explain the last joints without it.
        return bool(improved.any() and np.nanmax(worst) <= _RIGHT)
    if found.suspect.kind == "gears":
        # In a free swing weight and inertia cancel, and small errors of both look like gears. But then the unexplained
        # share is small as recorded, too.
        recorded = np.exp(found.gains) * (found.unexplained + ENOUGH) - ENOUGH
        return bool((improved & (np.nanmax(recorded, axis=0, initial=0.0)[joints] > _RIGHT)).any())
    if found.suspect.kind == "torque":
        # A factor on all joints may be caused by a load, unless two joints agree; one on some joints cannot.
        return int(improved.sum()) >= (2 if len(gains_of_joints) == len(gains) else 1)
    if found.suspect.kind == "pair":
        return _pair_is_certain(found)
    if found.suspect.kind == "sign" and found.suspect.moves:
        # The joint itself may need the same torque with both signs, if its position matters only to joints before it.
        every = (gains >= _FAR_BETTER) & (worst <= _RIGHT)
        return bool(every.any() and np.all(np.nan_to_num(gains_of_joints) >= -_WORSE))
    return int(improved.sum()) >= min(2, len(gains_of_joints))


def explains_nearly_all(found: ReadingFit) -> bool:
    """Whether the unexplained share is small on every joint whose fit the reading changes.

    Joints whose fit it does not change, as those with noise, say nothing about the reading.
    """
    worst = np.nanmax(found.unexplained, axis=0, initial=0.0, where=~np.isnan(found.unexplained))
    touched = np.abs(np.nan_to_num(found.joint_gains)) > _WORSE
    touched[list(found.suspect.joints)] = True
    return bool(worst[touched].max(initial=0.0) <= _RIGHT)


def _pair_is_certain(found: ReadingFit) -> bool:
    """Whether nearly all of the torque is explained after two mistakes were corrected."""
    shares = found.unexplained[~np.isnan(found.unexplained)]
    better = np.nan_to_num(found.joint_gains) >= _FAR_BETTER
    needed = min(2, int((~np.isnan(found.joint_gains)).sum()))
    return bool(len(shares) and np.median(shares) <= _BOTH_RIGHT and shares.max() <= _RIGHT and better.sum() >= needed)


def better_readings(robot: Robot, reading: Reading, step: float) -> list[ReadingFit]:
    """Mistakes that are certain, one after the other: each is found after those before it were corrected.

    Args:
        robot: The given model.
        reading: The data as recorded.
        step: Median time between two samples [s].
    """
    out: list[ReadingFit] = []
    for _ in range(_MOST_FAULTS):
        before = unexplained(robot, reading)
        units = [*other.time_suspects(robot, step), *other.length_suspects(robot, reading)]
        poor = _poorly_fitted(before)
        if not poor and not any(suspect.expected for suspect in units):
            return out or _compensated_gravity(robot, reading)
        tried = [fit_of(robot, before, reading, suspect) for suspect in (*units, *_suspects(robot, reading, poor))]
        certain = [one for one in tried if is_certain(one)]
        if not certain:
            return [*out, *_pair_of_mistakes(robot, reading, before, tried)] or _compensated_gravity(robot, reading)
        best = _likeliest(robot, reading, certain)
        if best.suspect.outcome == "rival":
            return out
        out.append(best)
        if best.suspect.outcome == "offer":
            return out
        corrected = best.suspect.read(reading)
        step *= float(np.ptp(corrected.motion.t) / np.ptp(reading.motion.t))
        reading, robot = corrected, best.suspect.model or robot
    return out


def _compensated_gravity(robot: Robot, reading: Reading) -> list[ReadingFit]:
    """The reading that a controller had subtracted gravity from the torque; for data in which no mistake is certain.

    Many robots carry a load that the model lacks. With such a load and gravity added, a robot with the model's inertias
    explains the torque. As recorded, only a robot with other inertias does.
    """
    suspects = compensated_suspects(robot, reading, loaded=True)
    if not suspects:
        return []
    before = unexplained(robot, reading, AS_MODELLED)
    found = [fit_of(robot, before, reading, one, AS_MODELLED) for one in suspects]
    return [one for one in found if is_certain(one) and explains_nearly_all(one)]


def _likeliest(robot: Robot, reading: Reading, certain: Sequence[ReadingFit]) -> ReadingFit:
    """The reading with the largest score; of readings with nearly equal scores, the one that fits the given model best.

    A plausible robot may have any offset, and torque constants of half to twice the stated ones. With these, a torque
    whose gravity part has the wrong sign fits, and so does a torque with half the gear ratio.
    """
    best_score = max(one.score - _FAR_BETTER * one.suspect.price for one in certain)
    tied = [one for one in certain if one.score > best_score - _EQUAL_FIT]
    if tied[0].suspect.kind != "attitude" and tied[0].suspect.outcome != "rival":
        tied = [one for one in tied if one.suspect.outcome != "rival"]
    if len(tied) == 1:
        return tied[0]
    costs = [
        misfit_as_modelled(one.suspect.model or robot, one.suspect.read(reading)) + _FAR_BETTER * one.suspect.price
        for one in tied
    ]
    least = min(costs)
    # The first one is taken: a wrong sign of a torque is more frequent than of a position.
    equal = [one for cost, one in zip(costs, tied, strict=True) if cost <= least + _EQUAL_FIT]
    best = equal[0].suspect
    if best.kind == "attitude":
        # The first direction of gravity is the simplest. Another zero of the first joint has the same effect.
        return replace(equal[0], twins=tuple(one.suspect for one in equal[1:] if one.suspect.outcome == "rival"))
    twins = [one.suspect for one in equal[1:] if one.suspect.joints == best.joints or one.suspect.kind == "length"]
    return replace(equal[0], twins=tuple(one for one in twins if one.kind == best.kind and one.outcome == "wrong"))


def _pair_of_mistakes(
    robot: Robot, reading: Reading, before: Float[Array, "2 nv"], singles: Sequence[ReadingFit]
) -> list[ReadingFit]:
    """Two mistakes that are certain together, but not each by itself.

    Args:
        robot: The given model.
        reading: The data as recorded.
        before: Their unexplained share.
        singles: Fits of readings that correct a single mistake.
    """
    worst = np.nanmin(before, axis=0, initial=np.inf, where=~np.isnan(before))
    if not (worst[np.isfinite(worst)] >= _FOR_TWO).any():
        return []
    as_recorded = plain_unexplained(robot, reading)
    driven = _driven(robot, reading)
    signs = [one for one in other.sign_suspects(robot, np.flatnonzero(driven).tolist()) if one.outcome == "wrong"]
    firsts = [*other.degree_suspects(robot, reading), *_best_in_quick_fit(robot, reading, as_recorded, signs, _FIRSTS)]
    pairs: list[tuple[float, Suspect, Suspect]] = []
    for first in firsts:
        try:
            corrected = first.read(reading)
            ratio = common_ratio(robot, corrected)
            seconds = [*other.torque_suspects(robot, ratio), *other.all_signs(robot), *signs]
            if ratio is not None and abs(np.log(ratio)) > OTHER_UNIT:
                seconds.append(factor_of_all(robot, 1 / ratio))
            # Two signs of the same joint are one mistake, which is tried by itself.
            seconds = [one for one in seconds if not (one.kind == "sign" and one.joints == first.joints)]
            pairs += [(_quick_gain(robot, as_recorded, second.read(corrected)), first, second) for second in seconds]
        except ChainError:
            continue
    pairs.sort(key=lambda pair: -pair[0])
    single = max((one.score for one in singles), default=0.0)
    for _, first, second in pairs[:_PAIRS]:
        both = fit_of(robot, before, reading, second.after(first))
        if not is_certain(both) or both.score <= single + _FAR_BETTER:
            continue
        # Both corrections have to be necessary.
        parts = [fit_of(robot, before, reading, one).score for one in (first, second)]
        if both.score > max(parts) + _FAR_BETTER:
            return [replace(both, suspect=first), replace(both, suspect=second)]
    return []


def _quick_gain(robot: Robot, as_recorded: Float[Array, " nv"], corrected: Reading) -> float:
    """Sum over all joints of the gain of a reading by quick fits."""
    return float(np.nansum(np.log((as_recorded + ENOUGH) / (plain_unexplained(robot, corrected) + ENOUGH))))


def _best_in_quick_fit(
    robot: Robot, reading: Reading, as_recorded: Float[Array, " nv"], suspects: Sequence[Suspect], count: int
) -> list[Suspect]:
    """The ``count`` mistakes whose correction gains most in quick fits of all joints."""
    gains = [_quick_gain(robot, as_recorded, suspect.read(reading)) for suspect in suspects]
    return [suspects[k] for k in np.argsort(gains)[::-1][:count]]


def _poorly_fitted(before: Float[Array, "2 nv"]) -> list[int]:
    """Joints whose unexplained share is so large that their fit could become far better."""
    possible = _joint_gains(np.log((before + ENOUGH) / ENOUGH))
    return np.flatnonzero(np.nan_to_num(possible) >= _FAR_BETTER).tolist()


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
    of_shape = [
        *other.degree_suspects(robot, reading),
        *(one for one in motors if one.turned),
        *(other.all_signs(robot) if signed == list(poor) else ()),
        *other.sign_suspects(robot, signed),
        *other.order_suspects(robot, signed),
    ]
    return [
        *(one for one in motors if not one.turned),
        *_units_closer_in_size(robot, reading, other.torque_suspects(robot, ratio)),
        *unit_suspects(robot, reading),
        *factor_suspects(robot, reading),
        *compensated_suspects(robot, reading),
        *attitude_suspects(robot, reading),
        *_better_in_quick_fit(robot, reading, of_shape),
    ]


def _units_closer_in_size(robot: Robot, reading: Reading, suspects: Sequence[Suspect]) -> list[Suspect]:
    """The units with which the torques are closer in size to the modelled torques than as recorded."""
    needed = (inverse_dynamics(robot, reading.motion) - modelled_friction(robot, reading.motion)).std(axis=0)

    def distance(tau: Float[Array, "N nv"]) -> float:
        size = (tau + reading.external).std(axis=0)
        known = (needed > 0) & (size > 0)
        return abs(float(np.median(np.log(size[known] / needed[known])))) if known.any() else np.inf

    as_recorded = distance(reading.tau)
    return [one for one in suspects if distance(one.read(reading).tau) < as_recorded]


def _driven(robot: Robot, reading: Reading) -> Bool[Array, " nv"]:
    """True for joints whose torque has a plausible size and both signs; False for idle or unsigned ones."""
    needed = inverse_dynamics(robot, reading.motion) - modelled_friction(robot, reading.motion)
    turns = np.ptp(np.sign(needed), axis=0) == 2
    unsigned = turns & ((reading.tau.min(axis=0) >= 0) | (reading.tau.max(axis=0) <= 0))
    return (reading.tau.std(axis=0) >= _IDLE * needed.std(axis=0)) & ~unsigned


def _better_in_quick_fit(robot: Robot, reading: Reading, suspects: Sequence[Suspect]) -> list[Suspect]:
    """The mistakes whose correction improves a quick fit; at most `_FITTED_IN_FULL`."""
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
    return [suspects[k] for k in sorted(best.tolist()) if gains[k] > _WORSE]
