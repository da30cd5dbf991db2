"""Data types of a recording that is ready for fitting: motion with derivatives, torque, and the filter of both."""

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
    """Filter for torque and every regressor column: a symmetric FIR low pass without delay, then decimation.

    Attributes:
        rate_hz: Rate of the input samples.
        cutoff_hz: Edge of the band (-6 dB).
        kernel: Symmetric FIR kernel of odd length; ``[1.0]`` leaves signals as they are.
        step: Decimation: every ``step``-th sample is kept.
    """

    rate_hz: float
    cutoff_hz: float
    kernel: Float[Array, " m"]
    step: int

    @property
    def half(self) -> int:
        """Number of samples lost at either end, where the kernel would extend beyond the recording."""
        return len(self.kernel) // 2

    @property
    def output_rate_hz(self) -> float:
        """Rate of the output samples."""
        return self.rate_hz / self.step

    def samples(self, count: int) -> Int[Array, " n"]:
        """Index of the input sample at the centre of each output sample, for ``count`` input samples."""
        return np.arange(self.half, count - self.half, self.step)

    def __call__(self, x: Float[Array, "N ..."]) -> Float[Array, "n ..."]:
        """``x``, filtered and decimated along its first axis (time); samples at the ends are left out, see `half`."""
        if len(self.kernel) == 1:
            return x[:: self.step]
        flat = np.asarray(x, dtype=float).reshape(len(x), -1)
        return filtered(self.kernel, flat, self.step).reshape(-1, *x.shape[1:])


@dataclass(frozen=True)
class BaseSensors:
    """Sensors on a floating base.

    Attributes:
        gyroscope: Frame of the gyroscope.
        accelerometer: Frame of the accelerometer.
        noise: Standard deviations of their white noise [rad/s, m/s^2].
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
        band: Filter for torque and regressor columns.
        valid: False for samples that must not be used (excluded, or in a gap), shape ``(N,)``.
        raw_q: Positions [rad or m] before they were low-passed, shape ``(N, nv)``; None if not available.
        q_ref: References of the position controllers at the same instants, shape ``(N, nv)``; None if not recorded.
        external: Torque of measured external forces on the joints [N m or N], ``(N, nv)``; None if no force was
            measured.
        reading_steps: Encoder step of each joint [rad or m]; None for a joint whose readings have no common step. Empty
            if not determined.
        temperature: Temperature of the drives [deg C] at the same instants, ``(N, nv)``, NaN for joints without a
            sensor; None if no joint has one.
        references: References of the controllers, if the torque was computed from them; None if it was measured.
        touched: True where a joint carries a link that touches, or may touch, its surroundings, ``(N, nv)``: the
            joint's torque is not used then. None without knowledge of contacts.
        arrival: Change of the torque if references arrive one sample later [N m or N], ``(N, nv)``, for voltages that
            were read once per held reference, see `identification.data.drives.arrivals`; None without such joints.
        switching: Standard deviation of the torque where a drive may reduce its voltage between two samples [N m or N],
            ``(N, nv)``. It has a sign, so that filters act on it as on the torque. None if ``arrival`` is None.
        noise_covariance: Autocovariance, at lags of 0, 1 and 2 samples, that white torque noise of unit variance has
            after interpolation to the uniform rate, see `identification.data.signals.interpolated_noise`.
        position_edges: Edge of the low pass of each joint's positions [Hz], ``(nv,)``, see
            `identification.data.derivatives`; None if all joints have `identification.data.derivatives.motion_edge`.
        base_sensors: Sensors on a floating base; None for a fixed one.
        braked: Joints that stand on a brake in some rests. There ``tau`` is the torque of the model.
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
    braked: tuple[str, ...] = ()

    def __post_init__(self):
        object.__setattr__(self, "tau", read_only(self.tau))
        object.__setattr__(self, "valid", read_only(self.valid, bool))

    @property
    def samples(self) -> Int[Array, " n"]:
        """Index of each decimated sample among the samples at the full rate."""
        return self.band.samples(len(self.motion.t))

    def later_references(self, frames: Iterable[tuple[str, float]]) -> Float[Array, "N nv"]:
        """Change of the torque [N m or N] if references arrive later.

        Args:
            frames: Pairs of a joint and the delay of its references, as a share of the time for which a reference is
                held.
        """
        out = np.zeros_like(self.tau)
        if self.arrival is not None:
            for joint, part in frames:
                row = self.joint_names.index(joint)
                out[:, row] = part * self.arrival[:, row]
        return out

    def noise_gain(self, hz: Float[Array, " k"]) -> Float[Array, " k"]:
        """Power density of white torque noise at frequencies ``hz``, relative to that at zero.

        It falls with frequency if the samples were unevenly spaced, as interpolation is a low pass.
        """
        lag_0, lag_1, lag_2 = self.noise_covariance
        phase = 2.0 * np.pi * np.asarray(hz) / self.band.rate_hz
        power = lag_0 + 2.0 * lag_1 * np.cos(phase) + 2.0 * lag_2 * np.cos(2.0 * phase)
        return power / (lag_0 + 2.0 * lag_1 + 2.0 * lag_2)

    @cached_property
    def valid_in_band(self) -> Bool[Array, " n"]:
        """True for decimated samples that were filtered from valid samples only."""
        return self._filtered_without(~self.valid)

    @cached_property
    def untouched_in_band(self) -> Bool[Array, "n nv"]:
        """True for decimated samples of a joint's torque that were filtered from samples without contact only."""
        if self.touched is None:
            return np.ones((len(self.samples), len(self.joint_names)), dtype=bool)
        return np.column_stack([self._filtered_without(column) for column in self.touched.T])

    def _filtered_without(self, bad: Bool[Array, " N"]) -> Bool[Array, " n"]:
        """True for decimated samples whose filter kernel covers no ``bad`` sample."""
        bad_before = np.concatenate([[0], np.cumsum(bad)])
        centre, half = self.samples, self.band.half
        return bad_before[centre + half + 1] == bad_before[centre - half]
