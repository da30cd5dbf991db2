# pyright: reportAttributeAccessIssue=false
"""Samples of a recording with other units, signs or order of joints than recorded, to test which fit the model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from identification.data.checks.smoothed_copy import SmoothedRecording
from identification.data.derivatives import zero_phase
from identification.data.drives.joint_torque import per_speed
from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion

_ROWS = 400  # samples in a regression: enough for thirty coefficients in each half, and quick for many readings
_FEWEST = 60
# A joint's velocity has the first share of its power below some frequency. The second number times this frequency is
# the edge of the band: above the edge there is mostly noise.
_MOVING, _MARGIN = 0.99, 2.0
# A torque is constant if its standard deviation is at most this share of its largest value. The low pass makes rounding
# errors of 1e-13.
_CONSTANT = 1e-9


@dataclass(frozen=True)
class Reading:
    """Samples of motion and torque under one assumption on units, signs and order of joints.

    Attributes:
        motion: Samples of smooth motion.
        sign: Sign of the velocity, smoothed like the torque, shape ``(N, nv)``.
        tau: Torque of the drives, shape ``(N, nv)``.
        external: Torque that measured forces cause at the joints, shape ``(N, nv)``, the same in every reading.
        late_by_speed: Largest error per velocity [N m s/rad or N s/m] of torques that were computed from voltages,
            shape ``(nv,)``, zero for other joints; None if no torque was computed from a voltage.
        late_by_acceleration: Largest error per acceleration [kg m^2 or kg] of the same torques, shape ``(nv,)``.
    """

    motion: Motion
    sign: Float[Array, "N nv"]
    tau: Float[Array, "N nv"]
    external: Float[Array, "N nv"]
    late_by_speed: Float[Array, " nv"] | None = None
    late_by_acceleration: Float[Array, " nv"] | None = None


def of_voltages(reading: Reading, robot: Robot, torque_from: Mapping[str, str], step: float) -> Reading:
    """The reading with bounds on the errors of torques that were computed from voltages.

    Most of a servo's voltage is back-EMF, and the torque is proportional to the small difference between them. An error
    of a few per cent of the back-EMF, or a voltage read half a sample late, is as large as friction or the torque of
    the rotor.

    Args:
        reading: The data as recorded.
        robot: The robot with the constants of its motors.
        torque_from: Quantity from which the torque of each joint was computed, ``u`` for a voltage.
        step: Time between two samples [s].
    """
    back_emf = np.array(
        [
            per_speed(actuator) if torque_from.get(joint) == "u" else 0.0
            for joint, actuator in zip(robot.joint_names, robot.actuators, strict=True)
        ]
    )
    return replace(reading, late_by_speed=back_emf, late_by_acceleration=step * back_emf)


def reading_of(smooth: SmoothedRecording, external: Float[Array, "M nv"] | None = None) -> Reading | None:
    """The data as recorded, low-passed to the band in which the robot moves.

    Args:
        smooth: Low-passed copy of the recording.
        external: Torque of measured forces at the times of ``smooth``; None without measured forces.

    Returns:
        The reading; None without torque or with too few samples.
    """
    rows = smooth.rows(_ROWS)
    if smooth.tau is None or len(rows) < _FEWEST:
        return None
    cutoff, rate = _moving_edge(smooth), 1 / smooth.step

    def in_band(values: Float[Array, "M nv"]) -> Float[Array, "N nv"]:
        return values[rows] if cutoff >= smooth.cutoff_hz else zero_phase(values, rate, cutoff)[rows]

    motion = Motion(smooth.t[rows], in_band(smooth.q), in_band(smooth.v), in_band(smooth.a))
    tau = in_band(smooth.tau)
    return Reading(motion, in_band(smooth.sign), tau, np.zeros_like(tau) if external is None else in_band(external))


def as_recorded(
    smooth: SmoothedRecording,
    robot: Robot,
    torque_from: Mapping[str, str],
    external: Float[Array, "M nv"] | None = None,
) -> Reading | None:
    """The data as recorded (`reading_of`), with the possible errors of torques that were computed from voltages.

    Args:
        smooth: Low-passed copy of the recording.
        robot: The robot with the constants of its motors.
        torque_from: The quantity from which the torque of each joint was computed.
        external: Torque of measured forces at the times of ``smooth``; None without measured forces.
    """
    reading = reading_of(smooth, external)
    return None if reading is None else of_voltages(reading, robot, torque_from, smooth.step)


def _moving_edge(smooth: SmoothedRecording) -> float:
    """Frequency [Hz] above which the velocities are mostly noise, at most the cut-off of the smoothed copy."""
    v = smooth.v[smooth.inside] - smooth.v[smooth.inside].mean(axis=0)
    power = np.abs(np.fft.rfft(v * np.hanning(len(v))[:, None], axis=0)) ** 2
    frequencies = np.fft.rfftfreq(len(v), smooth.step)
    edges = [
        frequencies[np.searchsorted(np.cumsum(column) / column.sum(), _MOVING)]
        for column in power.T
        if column.sum() > 0
    ]
    return min(_MARGIN * float(max(edges, default=np.inf)), smooth.cutoff_hz)


def varies(tau: Float[Array, "N nv"]) -> Bool[Array, " nv"]:
    """True for torques that vary by more than rounding."""
    return tau.std(axis=0) > _CONSTANT * np.abs(tau).max(axis=0)


def with_positions_times(reading: Reading, factor: Float[Array, " nv"]) -> Reading:
    """The reading with the positions of each joint times a factor; a negative factor reverses the joint's direction."""
    m = reading.motion
    return replace(
        reading,
        motion=Motion(m.t, m.q * factor, m.v * factor, m.a * factor),
        sign=reading.sign * np.sign(factor),
    )


def with_positions_plus(reading: Reading, shift: Float[Array, " nv"]) -> Reading:
    """The reading with an offset [rad or m] added to the positions of each joint."""
    m = reading.motion
    return replace(reading, motion=Motion(m.t, m.q + shift, m.v, m.a))


def with_torques_times(reading: Reading, factor: Float[Array, " nv"]) -> Reading:
    """The reading with the torques of each joint's drive times a factor."""
    return replace(reading, tau=reading.tau * factor)


def with_torques_plus(reading: Reading, torque: Float[Array, "N nv"]) -> Reading:
    """The reading with a torque added to those of the drives."""
    return replace(reading, tau=reading.tau + torque)


def with_time_times(reading: Reading, factor: float) -> Reading:
    """The reading with its time times a factor; velocities and accelerations follow."""
    m = reading.motion
    return replace(reading, motion=Motion(m.t * factor, m.q, m.v / factor, m.a / factor**2))


def with_order(reading: Reading, order: Sequence[int], *, positions: bool, torques: bool) -> Reading:
    """The reading with the columns of positions, of torques or of both in another order of the joints."""
    at, m = list(order), reading.motion
    motion = Motion(m.t, m.q[:, at], m.v[:, at], m.a[:, at]) if positions else m
    return replace(
        reading,
        motion=motion,
        sign=reading.sign[:, at] if positions else reading.sign,
        tau=reading.tau[:, at] if torques else reading.tau,
    )
