# pyright: reportAttributeAccessIssue=false
"""Measured poses of frames, with positions, velocities and modelled loads of the joints, ready for fitting."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from identification.data.checks.smoothed_copy import included, smoothed
from identification.data.recording import Recording
from phantom_dyn.array_types import Array, Float, read_only
from phantom_dyn.dynamics.dynamics import link_torque
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion
from phantom_dyn.signals.splines import interpolated

MOST = 1200
"""Largest number of poses of one recording that are used, evenly spaced: neighbours in time are redundant."""
# Samples count as a motion if the median step of each joint is less than this share of its range.
_DENSE = 0.02
_FEWEST_OF_MOTION = 200  # fewer samples never count as a motion
_AT_EDGE = 1.0  # time [s] left out at both ends of a motion, because derivatives are not accurate there
_MOVES = 1e-3  # a delay can show only if some joint is faster than this [rad/s or m/s]


@dataclass(frozen=True)
class PoseSet:
    """Measured poses of one frame in one recording.

    Attributes:
        recording: Index of the recording; all its frames share the pose of the base and the delay.
        file: Name of the recording.
        frame: Name of the frame.
        index: Index of the frame in Pinocchio.
        t: Time [s], ``(n,)``.
        q: Readings of the joint positions [rad or m], ``(n, nv)``.
        v: Joint velocities, ``(n, nv)``: zeros for poses at rest.
        load: Modelled torque that the transmissions pass to the links [N m or N], ``(n, nv)``.
        position: Measured position [m], ``(n, 3)``.
        turn: Measured orientation, x, y, z, w, ``(n, 4)``; None if it was not measured.
        moving: True if the recording is a motion, so that a delay between pose and joints can show.
    """

    recording: int
    file: str
    frame: str
    index: int
    t: Float[Array, " n"]
    q: Float[Array, "n nv"]
    v: Float[Array, "n nv"]
    load: Float[Array, "n nv"]
    position: Float[Array, "n 3"]
    turn: Float[Array, "n 4"] | None
    moving: bool


def has_poses(recordings: tuple[Recording, ...]) -> bool:
    """True if any recording holds poses of a frame."""
    return any(recording.positions for recording in recordings)


def is_motion(recording: Recording) -> bool:
    """True if the samples follow a motion, False if they are single poses far from each other."""
    if len(recording.t) < _FEWEST_OF_MOTION:
        return False
    span = np.ptp(recording.q, axis=0)
    steps = np.median(np.abs(np.diff(recording.q, axis=0)), axis=0)
    moved = span > 0
    return bool(moved.any() and np.all(steps[moved] < _DENSE * span[moved]))


def measured_poses(
    robot: Robot, recordings: tuple[Recording, ...]
) -> tuple[tuple[PoseSet, ...], dict[int, CubicSpline]]:
    """Poses of every frame of every recording, and joint positions over time of the recordings that are motions.

    Args:
        robot: The given model, which predicts the loads.
        recordings: Recordings; those without measured poses are ignored.
    """
    out: list[PoseSet] = []
    paths: dict[int, CubicSpline] = {}
    for number, recording in enumerate(recordings):
        if not recording.positions:
            continue
        rows, v, load, moving = _motion(robot, recording)
        if moving:
            paths[number] = CubicSpline(recording.t, recording.q)
        for frame, position in recording.positions.items():
            turn = recording.orientations.get(frame)
            out.append(
                PoseSet(
                    number,
                    recording.file,
                    frame,
                    robot.model.getFrameId(frame),
                    read_only(recording.t[rows]),
                    read_only(recording.q[rows]),
                    read_only(v),
                    read_only(load),
                    read_only(position[rows]),
                    None if turn is None else read_only(turn[rows]),
                    moving,
                )
            )
    return tuple(out), paths


def _motion(robot: Robot, recording: Recording) -> tuple[Array, Array, Array, bool]:
    """Indices of the samples that are used, joint velocities and loads there, and True if the samples are a motion."""
    inside = included(recording)
    smooth = smoothed(recording) if is_motion(recording) else None
    if smooth is None:
        rows = _evenly_thinned(np.flatnonzero(inside))
        q = recording.q[rows]
        rest = np.zeros_like(q)
        return rows, rest, link_torque(robot, Motion(recording.t[rows], q, rest, rest)), False
    t = recording.t
    inside &= (t > t[0] + _AT_EDGE) & (t < t[-1] - _AT_EDGE)
    rows = _evenly_thinned(np.flatnonzero(inside))
    at = t[rows]

    def at_rows(values: Array) -> Array:
        return interpolated(at, smooth.t, values)

    v = at_rows(smooth.v)
    load = link_torque(robot, Motion(at, recording.q[rows], v, at_rows(smooth.a)))
    return rows, v, load, bool(np.abs(v).max(initial=0.0) > _MOVES)


def load_of(robot: Robot, recording: Recording) -> Float[Array, "n nv"]:
    """Modelled torque that the transmissions pass to the links at every sample [N m or N].

    Args:
        robot: The given model.
        recording: A motion, or poses at rest.
    """
    smooth = smoothed(recording) if is_motion(recording) else None
    v = a = np.zeros_like(recording.q)
    if smooth is not None:
        v, a = (interpolated(recording.t, smooth.t, values) for values in (smooth.v, smooth.a))
    return link_torque(robot, Motion(recording.t, recording.q, v, a))


def _evenly_thinned(rows: Array) -> Array:
    """At most `MOST` of the rows, evenly spaced."""
    if len(rows) <= MOST:
        return rows
    return rows[np.linspace(0, len(rows) - 1, MOST).astype(int)]
