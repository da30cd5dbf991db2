"""Reads the columns of a floating base (``w.``, ``sf.``, ``contact.``), and computes the motion of the base.

``w.`` are readings of a gyroscope, ``sf.`` of an accelerometer. They go through the same low pass as the joints'
positions. To find the effect of the sensors' white noise, random noise is drawn and filtered in the same way.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from identification.data.derivatives import zero_phase
from identification.data.log import BaseSensors, Log
from identification.data.recording import BaseReadings, Recording, Table
from phantom_dyn.array_types import Array, Float, read_only
from phantom_dyn.dynamics.moving_base import base_motion, place_on_base
from phantom_dyn.errors import LogError, RobotError, known_names, listed
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import BaseMotion
from phantom_dyn.signals.splines import interpolated, quintic_derivatives

_CONTACT = "contact."
_SENSORS = {"w": "gyroscope, the angular velocity [rad/s]", "sf": "accelerometer, the specific force [m/s^2]"}


def base_readings(
    table: Table, robot: Robot, sensors: Mapping[str, Mapping[str, Float[Array, "N 3"]]]
) -> tuple[BaseReadings | None, tuple[str, ...]]:
    """Readings of the sensors on the base, and warnings about them; None for a fixed base.

    Args:
        table: Columns under their standard names.
        robot: States whether its base floats, and where the frames are.
        sensors: Readings [rad/s or m/s^2], shape ``(N, 3)``, by quantity (``w`` or ``sf``) and then by frame.

    Raises:
        LogError: If a sensor is missing or not on the base, or if a column of contacts cannot be used.
    """
    contacts = {name.removeprefix(_CONTACT): x for name, x in table.columns.items() if name.startswith(_CONTACT)}
    if not robot.floating:
        unused = [*(f"{quantity}." for quantity, found in sensors.items() if found), *([_CONTACT] if contacts else [])]
        if not unused:
            return None, ()
        return None, (
            f"{table.file}: the columns {listed(unused)} are not used, as {robot.name} is bolted down: write base: "
            "floating into robot.yaml if its base moves.",
        )
    frames = {quantity: _one_frame(table, robot, quantity, found) for quantity, found in sensors.items()}
    if any(name.startswith("f.") for name in table.columns):
        raise LogError(
            f"{table.file} has forces f.<frame>, which are in world axes, and the base of {robot.name} turns: leave "
            "them out, and say with contact.<frame> when a frame touches something."
        )
    _require_contacts(table, robot, contacts)
    readings = BaseReadings(
        frames["w"],
        frames["sf"],
        sensors["w"][frames["w"]],
        sensors["sf"][frames["sf"]],
        {frame: read_only(x) for frame, x in contacts.items()},
    )
    return readings, _uncovered_words(table, robot, readings)


def _one_frame(table: Table, robot: Robot, quantity: str, found: Mapping[str, Array]) -> str:
    """The frame on the base in whose axes a sensor measures, after a check that there is exactly one."""
    if not found:
        raise LogError(
            f"{table.file} has no columns {quantity}.<frame>.x, .y and .z, and {robot.name} is not bolted down (base: "
            f"floating): add what its {_SENSORS[quantity]}, reads, in the axes of a frame on the base."
        )
    if len(found) > 1:
        raise LogError(f"{table.file} has {quantity}. of {listed(list(found))}: give that of one frame on the base.")
    frame = next(iter(found))
    try:
        place_on_base(robot, frame)
    except RobotError as error:
        raise LogError(f"{table.file}, column {quantity}.{frame}.x: {error}") from error
    return frame


def _require_contacts(table: Table, robot: Robot, contacts: Mapping[str, Array]) -> None:
    """Raise an error for a contact of an unknown frame, or a value that is neither 0 nor 1."""
    frames = [frame.name for frame in robot.model.frames if frame.parentJoint > 0]
    for frame, values in contacts.items():
        if frame not in frames:
            raise LogError(
                f"{table.file}, column contact.{frame}: {robot.name} has no frame of that name that a joint moves: "
                f"{known_names(frame, frames, 'frames')}"
            )
        wrong = np.flatnonzero((values != 0) & (values != 1))
        if len(wrong):
            raise LogError(
                f"{table.file}, column contact.{frame} is {values[wrong[0]]:g} at t = "
                f"{table.columns['t'][wrong[0]]:g} s, wanted 0 or 1: a force is no contact yet, choose a threshold."
            )


def _uncovered_words(table: Table, robot: Robot, readings: BaseReadings) -> tuple[str, ...]:
    """A warning that names the joints on whose links no column states a contact."""
    if not readings.contacts:
        return ()
    covered = np.any([carrying_joints(robot, frame) for frame in readings.contacts], axis=0)
    free = [name for name, covered_row in zip(robot.joint_names, covered, strict=True) if not covered_row]
    if not free:
        return ()
    return (
        f"{table.file}: no contact.<frame> is of a frame that {listed(free)} moves: it is assumed that nothing touches "
        "these links.",
    )


def carrying_joints(robot: Robot, frame: str) -> np.ndarray:
    """True for joints on which a force at a frame causes a torque, shape ``(nv,)``.

    All values are True if a passive joint of a closed chain moves the frame, as closed chains transmit forces.
    """
    model = robot.model
    joint = model.frames[model.getFrameId(frame)].parentJoint
    rows_before: set[int] = set()
    while joint > 0:
        rows_before.add(model.joints[joint].idx_v)
        joint = model.parents[joint]
    if robot.chain is not None and any(row in rows_before for row in robot.chain.passive):
        return np.ones(robot.nv, dtype=bool)
    return np.array([row in rows_before for row in robot.tree_rows])


def readings_at(base: BaseReadings | None, rows: slice) -> BaseReadings | None:
    """The readings of some rows; None if there are no readings."""
    if base is None:
        return None
    contacts = {frame: read_only(x[rows]) for frame, x in base.contacts.items()}
    return replace(base, w=read_only(base.w[rows]), sf=read_only(base.sf[rows]), contacts=contacts)


def filtered_base(
    recording: Recording, robot: Robot, t: Float[Array, " N"], rate_hz: float, cutoff_hz: float
) -> BaseMotion:
    """Motion of the base on a uniform grid.

    Its angular acceleration is the derivative of a spline through the gyroscope's readings.

    Args:
        recording: Recording of a floating base.
        robot: States where the sensors are.
        t: Times of the grid [s], shape ``(N,)``.
        rate_hz: Sample rate of the grid [Hz].
        cutoff_hz: Edge of the low pass [Hz].
    """
    base = recording.base
    assert base is not None
    readings = np.hstack([base.w, base.sf])
    if t is not recording.t:
        readings = interpolated(t, recording.t, readings)
    w, dw, sf = _filtered(readings, rate_hz, cutoff_hz)
    return base_motion(robot, base.gyroscope, base.accelerometer, w, dw, sf)


def _filtered(readings: Float[Array, "N 6"], rate_hz: float, cutoff_hz: float) -> tuple[Array, Array, Array]:
    """Angular velocity, its derivative, and specific force after a low pass, each of shape ``(N, 3)``."""
    readings = zero_phase(readings, rate_hz, cutoff_hz)
    w = readings[:, :3]
    return w, quintic_derivatives(w, rate_hz)[0], readings[:, 3:]


def sensors_of_base(recording: Recording) -> BaseSensors | None:
    """Frames of gyroscope and accelerometer, and the white noise of each; None for a fixed base.

    The noise is estimated from third differences, in which motion nearly cancels. Their median ignores impacts. For
    normal white noise, 1.4826 times the median magnitude of third differences is their standard deviation, and their
    variance is 20 times that of the noise.
    """
    base = recording.base
    if base is None:
        return None
    w, sf = (1.4826 * float(np.median(np.abs(np.diff(x, 3, axis=0)))) / np.sqrt(20.0) for x in (base.w, base.sf))
    return BaseSensors(base.gyroscope, base.accelerometer, (float(w), float(sf)))


def with_redrawn_noise(log: Log, rng: np.random.Generator, cutoff_hz: float) -> BaseMotion | None:
    """Motion of the base with random noise of its sensors added; None if the base is fixed."""
    base, sensors = log.motion.base, log.base_sensors
    if base is None or sensors is None:
        return base
    errors = np.repeat(sensors.noise, 3) * rng.normal(size=(len(base.w), 6))
    w, dw, sf = _filtered(errors, log.band.rate_hz, cutoff_hz)
    return BaseMotion(base.w + w, base.dw + dw, base.f + sf)
