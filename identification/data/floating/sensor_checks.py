"""Checks the sensors on a floating base, and the columns that state contacts.

- Over a second the base gains hardly any speed, so the magnitude of the mean specific force equals gravity.
- Gravity has a constant direction in the world. In the axes of the base, it therefore turns with the angular velocity
  of the gyroscope, in the opposite direction.
- No contact force acts on a leg in the air, so the model predicts its torques better than on the ground.
"""

from __future__ import annotations

from itertools import permutations, product

import numpy as np

from identification.data.floating.base_columns import carrying_joints
from identification.data.floating.detected_contacts import unmodelled_torque
from identification.data.readers.map_entries import entries_words
from identification.data.recording import BaseReadings, Fault, Recording
from phantom_dyn.array_types import Array
from phantom_dyn.dynamics.moving_base import place_on_base
from phantom_dyn.model.robot import Robot
from phantom_dyn.signals.recursive import low_passed

_SECOND = 1.0
"""Time over which a base gains hardly any speed, and turns by little [s]."""
_OFF = 0.1
"""Largest difference between the mean specific force and gravity, as a share of gravity."""
_NONE = 0.3
"""Mean specific force, as a share of gravity, below which gravity was subtracted."""
_SLOW_HZ = 1.0
"""Edge of a low pass after which the specific force has nearly the direction of gravity [Hz]."""
_TURNS = 0.05
"""Smallest root mean square angular speed of the direction of gravity with which a gyroscope is checked [rad/s]."""
_BETTER, _GOOD = 0.5, 0.8
"""Other axes or units count as correct if their squared residual is at most the first share of the squared residual of
the given ones, and at most the second share of the squared angular speed of the direction of gravity."""
_DISTINCT = 0.05
"""The best axes are named only if the squared residual of the second best is larger, by at least this share of the
squared angular speed of the direction of gravity: a rotation about a single axis determines only two of the axes."""
_FASTER = 2.0
"""The base accelerates if the direction of the specific force turns this many times faster than the gyroscope reads."""
_SPINS, _FAR = 0.5, 0.05
"""The gyroscope of a robot that spins is in deg/s if its residual (root mean square) is above the first number [rad/s],
and if the squared residual with deg/s is below the second share of that with any axes and signs."""
_PER_G = 9.80665
_DEGREE = np.pi / 180
_WORSE = 1.5
"""A contact is inverted if the unmodelled torque is this many times larger while the column states no contact."""
_FEWEST = 100
"""Smallest number of samples for a check."""


def check_base(recording: Recording, robot: Robot) -> tuple[tuple[str, ...], tuple[Fault, ...]]:
    """Warnings and certain faults of the first check that fails: specific force, then gyroscope, then contacts."""
    base = recording.base
    if base is None:
        return (), ()
    rate = (len(recording.t) - 1) / (recording.t[-1] - recording.t[0])
    for check in (_specific_force, _gyroscope):
        warnings, wrong = check(recording, base, robot, rate)
        if warnings or wrong:
            return warnings, wrong
    return _contacts(recording, base, robot), ()


def _specific_force(
    recording: Recording, base: BaseReadings, robot: Robot, rate_hz: float
) -> tuple[tuple[str, ...], tuple[Fault, ...]]:
    """Warnings and faults if the mean specific force over a second is not as large as gravity, or points downwards."""
    gravity = float(np.linalg.norm(robot.model.gravity.linear))
    size = max(1, round(_SECOND * rate_hz))
    parts = base.sf[: len(base.sf) // size * size].reshape(-1, size, 3)
    if not len(parts):
        return (), ()
    means = parts.mean(axis=1)
    found = float(np.median(np.linalg.norm(means, axis=1)))
    column = f"sf.{base.accelerometer}"
    why = f"over a second its mean is {found:.3g} m/s^2, and gravity {gravity:.3g}"
    if abs(found * _PER_G / gravity - 1) < _OFF:
        entries = {f"{column}.{axis}": f"{{from: {column}.{axis}, unit: g}}" for axis in "xyz"}
        return (), (Fault(f"{column} is in g and not in m/s^2", why, entries_words(recording, entries)),)
    if found < _NONE * gravity:
        mend = "give the accelerometer as it reads, with gravity in it"
        return (), (Fault(f"gravity was taken out of {column}", why, mend),)
    if abs(found / gravity - 1) > _OFF:
        return (
            f"{recording.file}: {column} is not as large as gravity: {why}: correct its scale and its bias, or leave "
            "out times at which the robot does not move by itself.",
        ), ()
    up = float((place_on_base(robot, base.accelerometer).rotation @ means.mean(axis=0))[2])
    if up < -0.5 * gravity:
        return (
            f"{recording.file}: {column} points downwards on the base, and an accelerometer reads upwards at rest: "
            "write sign: -1 for its three columns into a column map if the robot is not upside down.",
        ), ()
    return (), ()


def _gyroscope(
    recording: Recording, base: BaseReadings, robot: Robot, rate_hz: float
) -> tuple[tuple[str, ...], tuple[Fault, ...]]:
    """Warnings and faults if the direction of gravity does not turn with the angular velocity of the gyroscope."""
    rotations = [place_on_base(robot, frame).rotation for frame in (base.gyroscope, base.accelerometer)]
    both = np.hstack([base.w @ rotations[0].T, base.sf @ rotations[1].T])
    if len(both) < _FEWEST or 0.2 * rate_hz < _SLOW_HZ:
        return (), ()
    both = low_passed(both, _SLOW_HZ, rate_hz, order=4, padding=min(int(3 * rate_hz / _SLOW_HZ), len(both) - 1))
    w, up = both[:, :3], both[:, 3:]
    up = up / np.maximum(np.linalg.norm(up, axis=1), 1e-300)[:, None]
    turning = np.gradient(up, 1 / rate_hz, axis=0)
    squared = max(float(np.mean(np.sum(turning**2, axis=1))), 1e-300)

    def residual(matrix: Array) -> float:
        """Share of the squared turning of gravity that the gyroscope, multiplied by a matrix, does not explain."""
        return float(np.mean(np.sum((turning + np.cross(w @ matrix.T, up)) ** 2, axis=1))) / squared

    given = residual(np.eye(3))
    column = f"w.{base.gyroscope}"
    why = f"it leaves {100 * given:.0f} % of the squares of gravity's turning in the axes of the base"
    degrees = residual(_DEGREE * np.eye(3))
    others = sorted(((residual(matrix), matrix.tolist()) for matrix in _other_axes()), key=lambda pair: pair[0])
    best, matrix = others[0]
    spins = given * squared > _SPINS**2 and degrees < _FAR * min(given, best)
    if spins or (squared > _TURNS**2 and degrees < min(_GOOD, _BETTER * given)):
        entries = {f"{column}.{axis}": f"{{from: {column}.{axis}, unit: deg/s}}" for axis in "xyz"}
        return (), (Fault(f"{column} is in deg/s and not in rad/s", why, entries_words(recording, entries)),)
    accelerated = squared > _FASTER**2 * np.mean(np.sum(w**2, axis=1))
    if squared < _TURNS**2 or accelerated or best > min(_GOOD, _BETTER * given):
        return (), ()
    distinct = others[1][0] > best + _DISTINCT
    better = f", but only {100 * best:.0f} % {_axes_words(matrix)}" if distinct else ""
    return (
        f"{recording.file}: {column} and sf.{base.accelerometer} do not turn alike: {why}{better}: correct the axes or "
        "signs of one of them, or the places of their frames.",
    ), ()


def _other_axes() -> list[Array]:
    """The 47 matrices that change the order or the signs of axes."""
    out = []
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            matrix = np.zeros((3, 3))
            matrix[range(3), order] = signs
            out.append(matrix)
    return out[1:]  # the first one changes nothing


def _axes_words(matrix: list[list[float]]) -> str:
    """Words for changed axes, as in ``with x, -y and -z of the gyroscope in the axes of the root in place of ...``."""
    words = [f"{'-' if min(row) < 0 else ''}{'xyz'[int(np.argmax(np.abs(row)))]}" for row in matrix]
    return f"with {words[0]}, {words[1]} and {words[2]} of the gyroscope in the axes of the root in place of x, y and z"


def _contacts(recording: Recording, base: BaseReadings, robot: Robot) -> tuple[str, ...]:
    """Warnings on frames whose column of contacts contradicts the torques."""
    if recording.tau is None or len(recording.t) < _FEWEST:
        return ()
    t, unmodelled = unmodelled_torque(recording, robot)
    out = []
    for frame, values in base.contacts.items():
        touches = np.interp(t, recording.t, values) > 0.5
        if min(touches.sum(), (~touches).sum()) < _FEWEST:
            continue
        rows = carrying_joints(robot, frame)
        largest = unmodelled[:, rows].max(axis=1)
        air, ground = float(np.median(largest[~touches])), float(np.median(largest[touches]))
        if air > _WORSE * ground:
            out.append(
                f"{recording.file}: contact.{frame} seems to be inverted: the model leaves {air:.2g} N m where it is "
                f"0, and {ground:.2g} where it is 1; write 1 while the frame touches something."
            )
    return tuple(out)
