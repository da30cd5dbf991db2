"""Finds joint limits of the model that simulated motion passes while a stop may have held the real robot."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from identification.data.log import Log
from identification.notes import Code, Note
from phantom_dyn.array_types import Array, Float
from phantom_dyn.model.robot import Robot, position_limits

# Positions count as at a limit within this share of the joint's range, because stops are elastic and encoders have
# offsets.
_LIMIT_TOLERANCE = 0.005


@dataclass(frozen=True)
class EngagedLimit:
    """A limit that simulated motion passes and recorded motion only reaches.

    Attributes:
        model: ``given`` or ``corrected``: the model that passes the limit.
        joint: Name of the joint.
        recording: Name of the recording.
        t: First time at which the limit is passed, in the recording's time [s].
        limit: The limit [rad or m].
        windows: Number of the recording's simulated windows in which the limit is passed.
        of: Number of all simulated windows of the recording.
    """

    model: str
    joint: str
    recording: str
    t: float
    limit: float
    windows: int
    of: int


@dataclass(frozen=True)
class Simulated:
    """Recorded and simulated motion of one window.

    Attributes:
        recording: Name of the recording.
        t: Times in the recording [s], ``(n,)``.
        read: Recorded positions, ``(n, nv)``.
        given: Simulated positions of the given model, ``(n, nv)``.
        corrected: Simulated positions of the corrected model, ``(n, nv)``.
    """

    recording: str
    t: Float[Array, " n"]
    read: Float[Array, "n nv"]
    given: Float[Array, "n nv"]
    corrected: Float[Array, "n nv"]


def limits_engaged(robot: Robot, windows: tuple[Simulated, ...]) -> tuple[EngagedLimit, ...]:
    """Limits that a model passes and the recording only reaches, one entry for each model, joint and recording.

    Args:
        robot: The robot with its limits; continuous joints have none.
        windows: At least one window.
    """
    limits, out = np.column_stack(position_limits(robot)), []
    for recording in dict.fromkeys(window.recording for window in windows):
        here = [window for window in windows if window.recording == recording]
        for model in ("given", "corrected"):
            for j, joint in enumerate(robot.joint_names):
                found = [x for x in (_passed(window, model, j, limits[j]) for window in here) if x is not None]
                if found:
                    t, limit = min(found)  # the earliest
                    out.append(EngagedLimit(model, joint, recording, t, limit, len(found), len(here)))
    return tuple(out)


def limit_notes(robot: Robot, engaged: tuple[EngagedLimit, ...]) -> tuple[Note, ...]:
    """One note per recording on limits that the corrected model passes, and one on those that only the given passes.

    All joints share a note, because many similar notes would hide the other notes.
    """
    corrected = {(one.joint, one.recording) for one in engaged if one.model == "corrected"}
    shown = [one for one in engaged if one.model == "corrected" or (one.joint, one.recording) not in corrected]
    units = dict(zip(robot.joint_names, robot.position_units, strict=True))
    out = []
    for recording, model in dict.fromkeys((one.recording, one.model) for one in shown):
        here = [one for one in shown if (one.recording, one.model) == (recording, model)]
        first, numbers = here[0], {"file": recording, "model": model, "of": here[0].of}
        if len(here) == 1:
            own = {"windows": first.windows, "limit": first.limit, "unit": units[first.joint], "t": first.t}
            out.append(Note(Code.RUNS_PAST_LIMIT, first.joint, numbers | own))
        else:
            places = tuple((one.joint, one.limit, units[one.joint], one.windows) for one in here)
            out.append(Note(Code.RUNS_PAST_LIMITS, None, numbers | {"places": places}))
    return tuple(out)


def recorded_past(robot: Robot, logs: Iterable[Log]) -> tuple[Note, ...]:
    """One note on each joint whose recorded positions are beyond the model's limits.

    Args:
        robot: The robot with its limits.
        logs: The recordings.
    """
    limits, out = np.column_stack(position_limits(robot)), []
    for log in logs:
        q = log.motion.q if log.raw_q is None else log.raw_q
        for j, joint in enumerate(robot.joint_names):
            lower, upper = limits[j]
            beyond = np.where(log.valid, np.maximum(lower - q[:, j], q[:, j] - upper), -np.inf)
            if beyond.max() <= _margin(limits[j]):
                continue
            first = int(np.argmax(beyond > 0))
            unit = robot.position_units[j]
            numbers = {"past": float(beyond.max()), "lower": float(lower), "upper": float(upper), "unit": unit}
            numbers |= {"file": log.file, "t": float(log.motion.t[first])}
            out.append(Note(Code.RECORDED_PAST_LIMITS, joint, numbers))
    return tuple(out)


def _passed(window: Simulated, model: str, j: int, limits: Float[Array, " 2"]) -> tuple[float, float] | None:
    """Time [s] at which a model first passes a limit of a joint, and the limit; None if it passes none.

    Only limits that the recorded motion reaches are considered: a diverging simulation passes other limits, too.
    """
    simulated = (window.given if model == "given" else window.corrected)[:, j]
    for limit, side in ((limits[0], -1.0), (limits[1], 1.0)):
        past = side * (simulated - limit) > _margin(limits)
        read = float(np.max(side * (window.read[:, j] - limit)))
        if past.any() and abs(read) <= _margin(limits):
            return float(window.t[int(np.argmax(past))]), float(limit)
    return None


def _margin(limits: Float[Array, " 2"]) -> float:
    """Tolerance at the limits of a joint [rad or m]."""
    width = float(limits[1] - limits[0])
    return _LIMIT_TOLERANCE * (width if np.isfinite(width) else 1.0)
