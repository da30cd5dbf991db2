"""Fits a recording with a suspected mistake corrected, and decides whether the mistake is certain.

The fits are those of `identification.data.checks.readings.plausible_fit`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification.data.checks.readings.plausible_fit import ENOUGH, PLAUSIBLE, Freedom, unexplained
from identification.data.checks.readings.reading import Reading
from identification.data.checks.readings.suspects import Suspect
from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import ChainError
from phantom_dyn.model.robot import Robot

FAR_BETTER = float(np.log(4.0))
"""Logarithm of the factor by which the unexplained share of a torque's variance falls in a far better fit, averaged
over both halves of the recording."""
# Logarithm of the factor by which the share has to fall in each half.
_EITHER_HALF = float(np.log(2.0))
WORSE = float(np.log(1.5))
"""Logarithm of the largest acceptable increase of the unexplained share of any joint."""
RIGHT = 0.15
"""Largest unexplained share that a correct reading may have."""
# Largest median of the unexplained shares, over joints and halves, after two mistakes were corrected.
_BOTH_RIGHT = 0.1


@dataclass(frozen=True)
class ReadingFit:
    """Fit of a reading, compared with the fit of the data as recorded.

    Attributes:
        suspect: The mistake that the reading corrects.
        gains: Logarithm of the unexplained share as recorded over that of the reading, for each half of the recording
            and each joint, ``(2, nv)``.
        unexplained: Unexplained share of the reading, ``(2, nv)``.
        freedom: How far the robots of both fits may be from their model.
        twins: Other mistakes that the data do not distinguish from ``suspect``.
    """

    suspect: Suspect
    gains: Float[Array, "2 nv"]
    unexplained: Float[Array, "2 nv"]
    freedom: Freedom = PLAUSIBLE
    twins: tuple[Suspect, ...] = ()

    @property
    def joint_gains(self) -> Float[Array, " nv"]:
        """Gain of each joint over both halves, by `joint_gains_of`."""
        return joint_gains_of(self.gains)

    @property
    def score(self) -> float:
        """Sum of the gains of all joints."""
        return float(np.nansum(self.joint_gains))


def joint_gains_of(gains: Float[Array, "2 nv"]) -> Float[Array, " nv"]:
    """Gain of each joint: the mean of both halves if both gain enough, else the smaller gain; NaN if both are NaN."""
    known = ~np.isnan(gains).all(axis=0)
    out = np.full(gains.shape[1], np.nan)
    smaller = np.nanmin(gains[:, known], axis=0)
    out[known] = np.where(smaller >= _EITHER_HALF, np.nanmean(gains[:, known], axis=0), smaller)
    return out


def poorly_fitted(shares: Float[Array, "2 nv"]) -> list[int]:
    """Joints whose unexplained share is so large that a correction could make their fit far better."""
    possible = joint_gains_of(np.log((shares + ENOUGH) / ENOUGH))
    return np.flatnonzero(np.nan_to_num(possible) >= FAR_BETTER).tolist()


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
        before: Unexplained shares of the data as recorded, ``(2, nv)``.
        reading: The data as recorded.
        suspect: The suspected mistake.
        freedom: How far the robot may be from its model.
    """
    corrected = suspect.read(reading)
    try:
        shares = unexplained(suspect.model or robot, corrected, freedom)
    except ChainError:
        # The loops of a closed chain do not close at these positions, so the reading cannot be correct.
        shares = np.full_like(before, np.inf)
    if suspect.kind == "gravity":
        # This reading adds the modelled weight to the torque, which changes the variance. The residual is still divided
        # by the variance of the measured torque.
        shares = shares * corrected.tau.var(axis=0) / np.maximum(reading.tau.var(axis=0), 1e-300)
    return ReadingFit(suspect, np.log((before + ENOUGH) / (shares + ENOUGH)), shares, freedom)


def is_certain(found: ReadingFit) -> bool:
    """True if a reading fits far better on the joints that it changes, and clearly worse on no joint.

    How many of these joints have to improve depends on the kind of mistake.
    """
    gains, joints = found.joint_gains, list(found.suspect.joints)
    gains_of_joints = gains[joints]
    if np.nanmin(gains, initial=0.0) < -WORSE:
        return False
    if found.suspect.expected:
        shares = found.unexplained[~np.isnan(found.unexplained)]
        return float(np.nansum(gains)) >= 0 and len(shares) > 0 and float(np.median(shares)) <= RIGHT
    worst = np.array([np.nanmax(column) if not np.isnan(column).all() else np.nan for column in found.unexplained.T])
    improved = (gains_of_joints >= FAR_BETTER) & (worst[joints] <= RIGHT)
    if found.suspect.kind == "order":
        return bool(improved.any() and np.all(gains_of_joints >= WORSE))
    # One improved joint is enough in five cases, which have other evidence as well:
    # - `gravity`: the torques of all joints together contain no weight;
    # - `length`: the recorded travel is impossible;
    # - `factors`: each factor is one that a drive has and no load causes;
    # - `voltage`: the torque grows with the speed as only a back-EMF does;
    # - `degrees`: a joint turns more than once only if its position is in degrees.
    if found.suspect.kind in ("gravity", "length", "factors", "voltage"):
        return bool(improved.any())
    if found.suspect.kind == "degrees" and found.suspect.turned:
        return bool(improved.any())
    if found.suspect.kind == "attitude":
        # Gravity is common to all joints, so every joint has to fit. One improved joint is enough, because with a load
        # that the model lacks the last joints may fit as recorded, too.
        return bool(improved.any() and np.nanmax(worst) <= RIGHT)
    if found.suspect.kind == "gears":
        # In a free swing the torques of weight and inertia cancel, and small errors of both look like gears. But then
        # the unexplained share is already small as recorded: so it has to be large here.
        recorded = np.exp(found.gains) * (found.unexplained + ENOUGH) - ENOUGH
        return bool((improved & (np.nanmax(recorded, axis=0, initial=0.0)[joints] > RIGHT)).any())
    if found.suspect.kind == "torque":
        # A load can imitate a factor on all joints, so two of them have to improve. No load imitates a factor on only
        # some of the joints: there one is enough.
        return int(improved.sum()) >= (2 if len(gains_of_joints) == len(gains) else 1)
    if found.suspect.kind == "pair":
        return _pair_is_certain(found)
    if found.suspect.kind == "sign" and found.suspect.moves:
        # The joint itself may need the same torque with either sign of its position. Then only joints before it in the
        # chain fit better, so that any improved joint is enough.
        improved_anywhere = (gains >= FAR_BETTER) & (worst <= RIGHT)
        return bool(improved_anywhere.any() and np.all(np.nan_to_num(gains_of_joints) >= -WORSE))
    return int(improved.sum()) >= min(2, len(gains_of_joints))


def explains_nearly_all(found: ReadingFit) -> bool:
    """True if the unexplained share is small on every joint whose fit the reading changes.

    A joint whose fit stays the same, such as a noisy one, says nothing about the reading.
    """
    worst = np.nanmax(found.unexplained, axis=0, initial=0.0, where=~np.isnan(found.unexplained))
    touched = np.abs(np.nan_to_num(found.joint_gains)) > WORSE
    touched[list(found.suspect.joints)] = True
    return bool(worst[touched].max(initial=0.0) <= RIGHT)


def _pair_is_certain(found: ReadingFit) -> bool:
    """True if the correction of two mistakes explains nearly all of the torque, and enough joints fit far better."""
    shares = found.unexplained[~np.isnan(found.unexplained)]
    better = np.nan_to_num(found.joint_gains) >= FAR_BETTER
    # One improved joint is enough where the recorded travel is impossible.
    impossible = any(part.turned or part.kind == "length" for part in found.suspect.parts)
    needed = 1 if impossible else min(2, int((~np.isnan(found.joint_gains)).sum()))
    return bool(len(shares) and np.median(shares) <= _BOTH_RIGHT and shares.max() <= RIGHT and better.sum() >= needed)
