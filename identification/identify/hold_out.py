"""Logs ready for a fit, and those that it may not see."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool

from identification.checks.motion import still_joints
from identification.log import Log
from identification.recordings import Recording
from identification.signals import choose_cutoff, process, uniform, within_limits
from phantom_dyn.errors import IdentifiabilityError, LogError
from phantom_dyn.motion import Motion
from phantom_dyn.robot import Robot

Array = np.ndarray

SHARE = 0.2
"""Of a single recording its last fifth is held out."""

_LEAST = 20  # samples in the band that a fit or a judgement needs at least


@dataclass(frozen=True)
class Split:
    """What a fit sees and what it is judged on.

    Attributes:
        train: Logs for the fit.
        test: Logs that no fit sees.
        words: What is held out, such as ``the last 20 % of log.csv (from 22 s on)``.
        cutoff_hz: Edge of the band.
    """

    train: tuple[Log, ...]
    test: tuple[Log, ...]
    words: str
    cutoff_hz: float


def split_logs(robot: Robot, recordings: tuple[Recording, ...], hold_out: tuple[Recording, ...] = ()) -> Split:
    """Logs in one band: held out is ``hold_out``, else the last of several recordings, else the end of the only one.

    The samples of both parts share no part of the filter's kernel.

    Args:
        robot: Says how torques were held and what the drives can give.
        recordings: At least one.
        hold_out: Recordings that no fit may see.

    Raises:
        LogError: If a recording is too short, or nothing is left on one side.
        IdentifiabilityError: If no joint moves in what is for the fit.
    """
    every = (*recordings, *hold_out)
    cutoff = _common_cutoff(every)
    still = [still_joints(recording, robot.prismatic) for recording in every]
    if all(joints.all() for joints in still[: len(recordings)]):
        raise IdentifiabilityError(
            f"{' and '.join(Path(recording.file).name for recording in recordings)}: no joint moves, so nothing can be "
            "identified: record a motion."
        )
    logs = tuple(process(recording, robot, cutoff_hz=cutoff) for recording in every)
    logs = tuple(
        replace(log, tau=within_limits(log.tau, robot), motion=_held(log.motion, joints))
        for log, joints in zip(logs, still, strict=True)
    )
    if hold_out:
        names = " and ".join(Path(recording.file).name for recording in hold_out)
        split = Split(logs[: len(recordings)], logs[len(recordings) :], names, cutoff)
    elif len(logs) == 1:
        split = _end_of(logs[0], cutoff)
    else:
        split = Split(logs[:-1], logs[-1:], f"{Path(logs[-1].file).name}, the last of {len(logs)} recordings", cutoff)
    for part, file, does in ((split.train, every[0].file, "to fit"), (split.test, every[-1].file, "to judge on")):
        samples = sum(int(log.valid_in_band.sum()) for log in part)
        if samples < _LEAST:
            raise LogError(
                f"{file}: {samples} samples in the band of {cutoff:.1f} Hz are left {does}, wanted {_LEAST}: "
                "record at least ten seconds of motion, or exclude less."
            )
    return split


def _held(motion: Motion, still: Bool[Array, " nv"]) -> Motion:
    """The motion with joints that never move at rest: the sign of a noise that is taken for a speed is no friction."""
    q = np.where(still, np.median(motion.q, axis=0), motion.q)
    return Motion(motion.t, q, np.where(still, 0.0, motion.v), np.where(still, 0.0, motion.a))


def _end_of(log: Log, cutoff_hz: float) -> Split:
    usable = log.motion.t[log.valid]
    if not len(usable):
        raise LogError(f"{log.file}: every sample is excluded: leave some of them.")
    start = float(np.quantile(usable, 1 - SHARE))
    before = log.motion.t < start
    words = f"the last {100 * SHARE:.0f} % of {Path(log.file).name} (from {start:.3g} s on)"
    train, test = replace(log, valid=log.valid & before), replace(log, valid=log.valid & ~before)
    return Split((train,), (test,), words, cutoff_hz)


def _common_cutoff(recordings: tuple[Recording, ...]) -> float:
    signals = []
    for recording in recordings:
        t, q, tau, _ = uniform(recording)
        signals.append((q, tau, (len(t) - 1) / (t[-1] - t[0])))
    return choose_cutoff(signals)
