"""A recording made ready for fitting: motion with derivatives, torque aligned to it, and the band that is analysed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from phantom_dyn.motion import Motion, read_only

Array = np.ndarray


@dataclass(frozen=True)
class Band:
    """The one filter that torque and every regressor column go through: zero-phase low pass, crop, decimation.

    Attributes:
        rate_hz: Rate of the samples that go in.
        cutoff_hz: Edge of the band; an infinite edge with ``step = 1`` and ``crop = 0`` lets everything through.
        step: Every ``step``-th sample comes out.
        crop: Samples left out at both ends, where the filter has only half of its past or future.
    """

    rate_hz: float
    cutoff_hz: float = np.inf
    step: int = 1
    crop: int = 0

    def __call__(self, x: Float[Array, "N ..."]) -> Float[Array, "n ..."]:
        """Samples of ``x`` in the band, first axis time."""
        stop = len(x) - self.crop
        if np.isfinite(self.cutoff_hz):
            from scipy.signal import butter, sosfiltfilt

            sos = butter(4, self.cutoff_hz, fs=self.rate_hz, output="sos")
            x = sosfiltfilt(
                sos, x, axis=0, padtype="odd", padlen=min(len(x) - 1, 3 * int(self.rate_hz / self.cutoff_hz))
            )
        return x[self.crop : stop : self.step]


@dataclass(frozen=True)
class Log:
    """Motion and torque of one recording, ready for fitting.

    Attributes:
        file: Name of the recording.
        joint_names: Second axis of the arrays.
        motion: Uniform samples of position, velocity and acceleration.
        tau: Drive torque [N m or N] at the same instants, shape ``(N, nv)``.
        band: Filter for torque and regressor columns alike.
        valid: False where a sample must not be used (excluded, in a gap), shape ``(N,)``.
    """

    file: str
    joint_names: tuple[str, ...]
    motion: Motion
    tau: Float[Array, "N nv"]
    band: Band
    valid: Bool[Array, " N"]

    def __post_init__(self):
        object.__setattr__(self, "tau", read_only(self.tau))
        mask = np.array(self.valid, dtype=bool)
        mask.flags.writeable = False
        object.__setattr__(self, "valid", mask)
