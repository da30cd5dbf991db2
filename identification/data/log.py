"""A recording made ready for fitting: motion with derivatives, torque aligned to it, and the band that is analysed."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from phantom_dyn._kernels.fir import filtered
from phantom_dyn.array_types import Array, Bool, Float, Int, read_only
from phantom_dyn.effects.operation import References
from phantom_dyn.motion import Motion


@dataclass(frozen=True)
class Band:
    """The one filter that torque and every regressor column go through: linear phase, no delay, then decimation.

    Attributes:
        rate_hz: Rate of the input samples.
        cutoff_hz: Edge of the band (-6 dB).
        kernel: Symmetric FIR kernel of odd length; ``[1.0]`` does not filter.
        step: Decimation: every ``step``-th sample is an output.
    """

    rate_hz: float
    cutoff_hz: float
    kernel: Float[Array, " m"]
    step: int

    @property
    def half(self) -> int:
        """Samples lost at both ends, where the kernel would reach over the edge of the recording."""
        return len(self.kernel) // 2

    @property
    def output_rate_hz(self) -> float:
        """Rate of the output samples."""
        return self.rate_hz / self.step

    def samples(self, count: int) -> Int[Array, " n"]:
        """Which of ``count`` input samples the output samples are centred on."""
        return np.arange(self.half, count - self.half, self.step)

    def __call__(self, x: Float[Array, "N ..."]) -> Float[Array, "n ..."]:
        """Samples of ``x`` in the band, first axis time; only those whose kernel lies inside the recording."""
        if len(self.kernel) == 1:
            return x[:: self.step]
        flat = np.asarray(x, dtype=float).reshape(len(x), -1)
        return filtered(self.kernel, flat, self.step).reshape(-1, *x.shape[1:])


@dataclass(frozen=True)
class BaseSensors:
    """Sensors on a base that is not bolted down.

    Attributes:
        gyroscope: Frame of the gyroscope.
        accelerometer: Frame of the accelerometer.
        noise: White noise of both [rad/s, m/s^2].
    """

    gyroscope: str
    accelerometer: str
    noise: tuple[float, float]


@dataclass(frozen=True)
class Log:
    """Motion and torque of one recording, ready for fitting; all arrays at the full, uniform rate.

    Attributes:
        file: Name of the recording.
        joint_names: Second axis of the arrays.
        motion: Uniform samples of position, velocity and acceleration.
        tau: Drive torque [N m or N] at the same instants, shape ``(N, nv)``.
        band: Filter for torque and regressor columns alike.
        valid: False where a sample must not be used (excluded, in a gap), shape ``(N,)``.
        raw_q: Positions [rad or m] before they were low-passed, shape ``(N, nv)``; None if not available.
        q_ref: References of the position controllers at the same instants, shape ``(N, nv)``; None where not recorded.
        external: Torque of measured external forces on the joints [N m or N], ``(N, nv)``; None without any.
        reading_steps: Step of each joint's recorded readings [rad or m]; None where they have no common step. Empty
            if not determined.
        temperature: Temperature of the drives [deg C] at the same instants, ``(N, nv)``, NaN for joints without; None
            if no joint has one.
        references: References of the controllers, where the torque was computed from them; None where it was measured.
        touched: True where a joint carries a link that touches, or may touch, its surroundings, ``(N, nv)``: its row is
            not used then. None without knowledge of contacts.
        arrival: Change of the torque if references arrive one sample later [N m or N], ``(N, nv)``, where voltages were
            read once while each was held, see `identification.data.drives.arrivals`; None without such joints.
        switching: Standard deviation of the torque where a drive drops its voltage between two readings [N m or N],
            ``(N, nv)``, with the sign of the change; None with ``arrival``.
        noise_covariance: Covariance at lags of zero, one and two steps of white torque readings of unit variance after
            interpolation to a uniform rate, see `identification.data.signals.interpolated_noise`.
        position_edges: Edge of the low pass of each joint's positions [Hz], ``(nv,)``, see
            `identification.data.derivatives`; None for that of the band.
        base_sensors: Sensors on a floating base; None for a fixed one.
    """

    file: str
    joint_names: tuple[str, ...]
    motion: Motion
    tau: Float[Array, "N nv"]
    band: Band
    valid: Bool[Array, " N"]
    raw_q: Float[Array, "N nv"] | None = None
    q_ref: Float[Array, "N nv"] | None = None
    external: Float[Array, "N nv"] | None = None
    reading_steps: tuple[float | None, ...] = ()
    temperature: Float[Array, "N nv"] | None = None
    references: References | None = None
    touched: Bool[Array, "N nv"] | None = None
    base_sensors: BaseSensors | None = None
    arrival: Float[Array, "N nv"] | None = None
    switching: Float[Array, "N nv"] | None = None
    noise_covariance: tuple[float, float, float] = (1.0, 0.0, 0.0)
    position_edges: Float[Array, " nv"] | None = None

    def __post_init__(self):
        object.__setattr__(self, "tau", read_only(self.tau))
        object.__setattr__(self, "valid", read_only(self.valid, bool))

    @property
    def samples(self) -> Int[Array, " n"]:
        """Full-rate index of each sample in the band."""
        return self.band.samples(len(self.motion.t))

    def later_references(self, frames: Iterable[tuple[str, float]]) -> Float[Array, "N nv"]:
        """Torque more [N m or N] where the references of some joints arrive later, each by a part of a frame."""
        out = np.zeros_like(self.tau)
        if self.arrival is not None:
            for joint, part in frames:
                row = self.joint_names.index(joint)
                out[:, row] = part * self.arrival[:, row]
        return out

    def noise_gain(self, hz: Float[Array, " k"]) -> Float[Array, " k"]:
        """Power of white torque readings at some frequencies [Hz] over that at zero: an uneven log loses the fast."""
        none, one, two = self.noise_covariance
        turn = 2.0 * np.pi * np.asarray(hz) / self.band.rate_hz
        return (none + 2.0 * one * np.cos(turn) + 2.0 * two * np.cos(2.0 * turn)) / (none + 2.0 * one + 2.0 * two)

    @cached_property
    def valid_in_band(self) -> Bool[Array, " n"]:
        """True for samples in the band whose kernel touches no sample that must not be used."""
        if self.valid.all():
            return np.ones(len(self.samples), dtype=bool)
        return self._reaches_none(~self.valid)

    @cached_property
    def untouched_in_band(self) -> Bool[Array, "n nv"]:
        """True for samples in the band of a row whose kernel reaches no sample in which it may be touched."""
        if self.touched is None:
            return np.ones((len(self.samples), len(self.joint_names)), dtype=bool)
        return np.column_stack([self._reaches_none(column) for column in self.touched.T])

    def _reaches_none(self, bad: Bool[Array, " N"]) -> Bool[Array, " n"]:
        count = np.concatenate([[0], np.cumsum(bad)])
        at, half = self.samples, self.band.half
        return count[at + half + 1] == count[at - half]
