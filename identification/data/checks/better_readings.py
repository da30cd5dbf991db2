"""Other readings of a recording (another unit, sign or order) that fit the model far better than the data as recorded.

No plausible robot explains the data as recorded, but one explains the other reading, in both halves of the recording:
see `identification.data.checks.readings.plausible_fit`.
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
from identification.data.checks.torques.scaled_model import common_ratio, plain_left
from identification.data.checks.torques.torque_factors import factor_of_all, factor_suspects, unit_suspects
from identification.data.checks.torques.torque_scales import OTHER_UNIT
from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.dynamics.dynamics import inverse_dynamics, modelled_friction
from phantom_dyn.errors import ChainError
from phantom_dyn.model.robot import Robot

# A reading is far better if the unexplained share falls to a quarter, half of the amplitude (geometric mean over both
# halves of the recording), and to at most a half in either half.
_FAR_BETTER, _EITHER_HALF = float(np.log(4.0)), float(np.log(2.0))
# Largest increase of the unexplained share of any joint.
_WORSE = float(np.log(1.5))
# Largest unexplained share with the right reading.
_RIGHT = 0.15
# Difference of the summed gains of two readings below which they fit equally well.
_TWINS = 0.5
# Share of the needed torque below which a joint is not driven, or is driven by something else.
_IDLE = 0.1
# Largest number of faults that are found one after the other.
_MOST_FAULTS = 3
# Unexplained share from which on two mistakes at once are looked for, and the largest one that both together may leave.
_FOR_TWO, _BOTH_RIGHT = 0.2, 0.1
# Number of signs that are tried first for pairs of mistakes, and number of pairs that are fitted in full.
_FIRSTS, _PAIRS = 6, 4
# Number of the best signs and orders by a quick fit that are fitted in full.
_TRIED = 6


@dataclass(frozen=True)
class Compared:
    """Fit of a reading, compared with that of the data as recorded.

    Attributes:
        suspect: The change that makes the reading.
        gains: Logarithm of the ratio of unexplained shares, as recorded over as read, ``(2, nv)``.
        left: Unexplained share of the reading, ``(2, nv)``.
        twins: Other readings that the data do not distinguish from it.
    """

    suspect: Suspect
    gains: Float[Array, "2 nv"]
    left: Float[Array, "2 nv"]
    twins: tuple[Suspect, ...] = ()

    @property
    def of_joints(self) -> Float[Array, " nv"]:
        """Gain of each joint, see `_of_joints`."""
        return _of_joints(self.gains)

    @property
    def score(self) -> float:
        """Sum of the gains."""
        return float(np.nansum(self.of_joints))


def _of_joints(gains: Float[Array, "2 nv"]) -> Float[Array, " nv"]:
    """Gain of each joint: the mean of both halves if both are large, else the smaller one; NaN without either."""
    said = ~np.isnan(gains).all(axis=0)
    out = np.full(gains.shape[1], np.nan)
    worse = np.nanmin(gains[:, said], axis=0)
    out[said] = np.where(worse >= _EITHER_HALF, np.nanmean(gains[:, said], axis=0), worse)
    return out


def compared(
    robot: Robot,
    before: Float[Array, "2 nv"],
    reading: Reading,
    suspect: Suspect,
    freedom: Freedom = PLAUSIBLE,
) -> Compared:
    """Comparison of a suspect's reading with the data as recorded."""
    read = suspect.read(reading)
    try:
        left = unexplained(suspect.model or robot, read, freedom)
    except ChainError:
        # With this reading the loops of a closed chain do not close, so that it is excluded.
        left = np.full_like(before, np.inf)
    if suspect.kind == "gravity":
        # Torque of the model that a reading adds must not lower the share, which is that of the measured torque.
        left = left * read.tau.var(axis=0) / np.maximum(reading.tau.var(axis=0), 1e-300)
    return Compared(suspect, np.log((before + ENOUGH) / (left + ENOUGH)), left)


def is_certain(found: Compared) -> bool:
    """Whether a reading fits far better on the joints that it changes, and no joint worse."""
    gains, joints = found.of_joints, list(found.suspect.joints)
    own = gains[joints]
    if np.nanmin(gains, initial=0.0) < -_WORSE:
        return False
    if found.suspect.expected:
        left = found.left[~np.isnan(found.left)]
        return float(np.nansum(gains)) >= 0 and len(left) > 0 and float(np.median(left)) <= _RIGHT
    worst = np.array([np.nanmax(column) if not np.isnan(column).all() else np.nan for column in found.left.T])
    mended = (own >= _FAR_BETTER) & (worst[joints] <= _RIGHT)
    if found.suspect.kind == "order":
        return bool(mended.any() and np.all(own >= _WORSE))
    # Readings that are tried only where the travel is absurd, or that only lead to an offer, need one joint.
    if found.suspect.says == "offer" or found.suspect.kind == "length":
        return bool(mended.any())
    if found.suspect.kind in ("factors", "voltage"):
        # No load makes factors of which each is that of a drive, and no torque grows so with the speed.
        return bool(mended.any())
    if found.suspect.kind == "attitude":
        # One gravity holds for all joints, and a load that the model lacks may explain the last ones either way.
        return bool(mended.any() and np.nanmax(worst) <= _RIGHT)
    if found.suspect.kind == "gears":
        # In a free swing weight and inertia cancel. Small errors of both then look like gears, but little is left.
        recorded = np.exp(found.gains) * (found.left + ENOUGH) - ENOUGH
        return bool((mended & (np.nanmax(recorded, axis=0, initial=0.0)[joints] > _RIGHT)).any())
    if found.suspect.kind == "torque":
        # One factor on all joints may be a load, which two joints rule out; the unit of some joints is no load.
        return int(mended.sum()) >= (2 if len(own) == len(gains) else 1)
    if found.suspect.kind == "degrees" and found.suspect.turned:
        # Joints that turn about more than once show their unit by themselves; one of them may have another mistake too.
        return bool(mended.any())
    if found.suspect.kind == "pair":
        return _pair_is_certain(found)
    if found.suspect.kind == "sign" and found.suspect.moves:
        # A joint may need the same torque with both readings, if its position matters only to the joints before it.
        every = (gains >= _FAR_BETTER) & (worst <= _RIGHT)
        return bool(every.any() and np.all(np.nan_to_num(own) >= -_WORSE))
    return int(mended.sum()) >= min(2, len(own))


def leaves_little(found: Compared) -> bool:
    """Whether a reading leaves little on every joint that it explains otherwise than before.

    What it leaves as it was, as the noise of another joint, says nothing about it.
    """
    rest = np.nanmax(found.left, axis=0, initial=0.0, where=~np.isnan(found.left))
    touched = np.abs(np.nan_to_num(found.of_joints)) > _WORSE
    touched[list(found.suspect.joints)] = True
    return bool(rest[touched].max(initial=0.0) <= _RIGHT)


def _pair_is_certain(found: Compared) -> bool:
    """Whether two mistakes at once explain nearly all of the torque that is unexplained without them."""
    left = found.left[~np.isnan(found.left)]
    better = np.nan_to_num(found.of_joints) >= _FAR_BETTER
    wanted = min(2, int((~np.isnan(found.of_joints)).sum()))
    return bool(len(left) and np.median(left) <= _BOTH_RIGHT and left.max() <= _RIGHT and better.sum() >= wanted)


def better_readings(robot: Robot, reading: Reading, step: float) -> list[Compared]:
    """Readings that are certainly better than the data as recorded, each one compared with the one before it.

    Args:
        robot: The given model.
        reading: The data as recorded.
        step: Median time between two samples [s].
    """
    out: list[Compared] = []
    for _ in range(_MOST_FAULTS):
        before = unexplained(robot, reading)
        units = [*other.time_suspects(robot, step), *other.length_suspects(robot, reading)]
        poor = _poor(before)
        if not poor and not any(suspect.expected for suspect in units):
            return out or _weight_taken_out(robot, reading)
        tried = [compared(robot, before, reading, suspect) for suspect in (*units, *_suspects(robot, reading, poor))]
        certain = [one for one in tried if is_certain(one)]
        if not certain:
            return [*out, *_two_at_once(robot, reading, before, tried)] or _weight_taken_out(robot, reading)
        best = _likeliest(robot, reading, certain)
        if best.suspect.says == "rival":
            return out
        out.append(best)
        if best.suspect.says == "offer":
            return out
        mended = best.suspect.read(reading)
        step *= float(np.ptp(mended.motion.t) / np.ptp(reading.motion.t))
        reading, robot = mended, best.suspect.model or robot
    return out


def _weight_taken_out(robot: Robot, reading: Reading) -> list[Compared]:
    """The reading that a controller took the weight out, where no other is certain, as many robots carry some load.

    A robot like its model explains it, with that load, and the data as recorded only one with other inertias.
    """
    suspects = compensated_suspects(robot, reading, loaded=True)
    if not suspects:
        return []
    before = unexplained(robot, reading, AS_MODELLED)
    found = [compared(robot, before, reading, one, AS_MODELLED) for one in suspects]
    return [one for one in found if is_certain(one) and leaves_little(one)]


def _likeliest(robot: Robot, reading: Reading, certain: Sequence[Compared]) -> Compared:
    """The reading that explains most; of those that some robot explains equally, the one that needs no other robot.

    A plausible robot may have any offset, and torque constants of half to twice the stated ones: with these, a torque
    with the wrong sign of its weight fits, and so does one with half a gear ratio.
    """
    worth = max(one.score - _FAR_BETTER * one.suspect.price for one in certain)
    tied = [one for one in certain if one.score > worth - _TWINS]
    if tied[0].suspect.kind != "attitude" and tied[0].suspect.says != "rival":
        tied = [one for one in tied if one.suspect.says != "rival"]
    if len(tied) == 1:
        return tied[0]
    costs = [
        misfit_as_modelled(one.suspect.model or robot, one.suspect.read(reading)) + _FAR_BETTER * one.suspect.price
        for one in tied
    ]
    least = min(costs)
    # The first one: a wrong sign of a torque is more frequent than of a position.
    equal = [one for cost, one in zip(costs, tied, strict=True) if cost <= least + _TWINS]
    best = equal[0].suspect
    if best.kind == "attitude":
        # Of directions of gravity the first is the simplest. Another zero of a first joint is as good as another base.
        return replace(equal[0], twins=tuple(one.suspect for one in equal[1:] if one.suspect.says == "rival"))
    twins = [one.suspect for one in equal[1:] if one.suspect.joints == best.joints or one.suspect.kind == "length"]
    return replace(equal[0], twins=tuple(one for one in twins if one.kind == best.kind and one.says == "wrong"))


def _two_at_once(
    robot: Robot, reading: Reading, before: Float[Array, "2 nv"], alone: Sequence[Compared]
) -> list[Compared]:
    """Two readings that are certain together and not alone; units come first.

    Args:
        robot: The given model.
        reading: The data as recorded.
        before: Their share that no plausible robot explains.
        alone: Single readings that were fitted in full.
    """
    worst = np.nanmin(before, axis=0, initial=np.inf, where=~np.isnan(before))
    if not (worst[np.isfinite(worst)] >= _FOR_TWO).any():
        return []
    plain = plain_left(robot, reading)
    driven = _driven(robot, reading)
    signs = [one for one in other.sign_suspects(robot, np.flatnonzero(driven).tolist()) if one.says == "wrong"]
    firsts = [*other.degree_suspects(robot, reading), *_most_promising(robot, reading, plain, signs, _FIRSTS)]
    pairs: list[tuple[float, Suspect, Suspect]] = []
    for first in firsts:
        try:
            read = first.read(reading)
            ratio = common_ratio(robot, read)
            seconds = [*other.torque_suspects(robot, ratio), *other.all_signs(robot), *signs]
            if ratio is not None and abs(np.log(ratio)) > OTHER_UNIT:
                seconds.append(factor_of_all(robot, 1 / ratio))
            # Degrees are never a part of two mistakes, and two signs of one joint make a third single one.
            seconds = [one for one in seconds if not (one.kind == "sign" and one.joints == first.joints)]
            for second in seconds:
                gain = _plain_gain(robot, plain, second.read(read))
                pairs.append((gain, first, second))
        except ChainError:
            continue
    pairs.sort(key=lambda pair: -pair[0])
    single = max((one.score for one in alone), default=0.0)
    for _, first, second in pairs[:_PAIRS]:
        both = compared(robot, before, reading, second.after(first))
        if not is_certain(both) or both.score <= single + _FAR_BETTER:
            continue
        # Each of the two has to be needed.
        parts = [compared(robot, before, reading, one).score for one in (first, second)]
        if both.score > max(parts) + _FAR_BETTER:
            return [replace(both, suspect=first), replace(both, suspect=second)]
    return []


def _plain_gain(robot: Robot, plain: Float[Array, " nv"], read: Reading) -> float:
    """Sum over all joints of the gain of a reading in a quick fit."""
    return float(np.nansum(np.log((plain + ENOUGH) / (plain_left(robot, read) + ENOUGH))))


def _most_promising(
    robot: Robot, reading: Reading, plain: Float[Array, " nv"], suspects: Sequence[Suspect], count: int
) -> list[Suspect]:
    """The readings with the largest gain in a quick fit of all joints."""
    gains = [_plain_gain(robot, plain, suspect.read(reading)) for suspect in suspects]
    return [suspects[k] for k in np.argsort(gains)[::-1][:count]]


def _poor(before: Float[Array, "2 nv"]) -> list[int]:
    """Joints whose fit could become far better in both halves."""
    possible = _of_joints(np.log((before + ENOUGH) / ENOUGH))
    return np.flatnonzero(np.nan_to_num(possible) >= _FAR_BETTER).tolist()


def _suspects(robot: Robot, reading: Reading, poor: Sequence[int]) -> list[Suspect]:
    """All readings but those of times and lengths."""
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
        *_nearer(robot, reading, other.torque_suspects(robot, ratio)),
        *unit_suspects(robot, reading),
        *factor_suspects(robot, reading),
        *compensated_suspects(robot, reading),
        *attitude_suspects(robot, reading),
        *_promising(robot, reading, of_shape),
    ]


def _nearer(robot: Robot, reading: Reading, suspects: Sequence[Suspect]) -> list[Suspect]:
    """Other units in which the torques as a whole are closer in size to the modelled ones."""
    needed = (inverse_dynamics(robot, reading.motion) - modelled_friction(robot, reading.motion)).std(axis=0)

    def away(tau: Float[Array, "N nv"]) -> float:
        size = (tau + reading.external).std(axis=0)
        known = (needed > 0) & (size > 0)
        return abs(float(np.median(np.log(size[known] / needed[known])))) if known.any() else np.inf

    now = away(reading.tau)
    return [one for one in suspects if away(one.read(reading).tau) < now]


def _driven(robot: Robot, reading: Reading) -> Bool[Array, " nv"]:
    """True for joints whose torque has a plausible size and both signs; False for idle or unsigned ones."""
    needed = inverse_dynamics(robot, reading.motion) - modelled_friction(robot, reading.motion)
    turns = np.ptp(np.sign(needed), axis=0) == 2
    unsigned = turns & ((reading.tau.min(axis=0) >= 0) | (reading.tau.max(axis=0) <= 0))
    return (reading.tau.std(axis=0) >= _IDLE * needed.std(axis=0)) & ~unsigned


def _promising(robot: Robot, reading: Reading, suspects: Sequence[Suspect]) -> list[Suspect]:
    """Suspects that a quick fit finds better than the data as recorded."""
    before = plain_left(robot, reading)
    gains = np.full(len(suspects), -np.inf)
    for k, suspect in enumerate(suspects):
        joints = list(range(robot.nv)) if suspect.moves else list(suspect.joints)
        try:
            after = plain_left(robot, suspect.read(reading))
        except ChainError:
            continue
        gains[k] = float(np.nansum(np.log((before[joints] + ENOUGH) / (after[joints] + ENOUGH))))
    best = np.argsort(gains)[::-1][:_TRIED]
    return [suspects[k] for k in sorted(best.tolist()) if gains[k] > _WORSE]
