r"""A sinusoidal encoder: position by interpolation between its lines, and the errors from imperfect signals.

Two tracks give a sine and a cosine of :math:`\varphi = 2\pi x / p` with pitch p; the arc tangent of both interpolates
within the pitch. Offsets :math:`o`, unequal amplitudes (ratio :math:`1 + m`), a phase error between the tracks
(:math:`\delta`) and saturation of the signals (third harmonic :math:`h`) cause an error that repeats with the pitch,

.. math:: \frac{2\pi}{p} (\hat x - x) \approx o_s \cos\varphi - o_c \sin\varphi + \frac{m}{2} \sin 2\varphi
   + \frac{\delta}{2} (1 + \cos 2\varphi) + h \sin 4\varphi

to first order. At a speed v the velocity has a ripple of :math:`o\,v`, :math:`m\,v`, :math:`\delta\,v` and
:math:`4 h\,v`, which finer steps do not remove. Every estimator takes the interpolated counts, edges included, as those
of a finer incremental encoder.

References:
    Cavusoglu, Feygin and Tendick (2002, section 7) planned sinusoidal encoders, finer by 16 to 64, and state no errors.
    The expansion is our own; tests compare it with the arc tangent.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.number_checks import require_positive, require_whole
from phantom_dyn.haptics.sensing.encoder import PHANTOM_STEP, Encoder, EncoderRecord, record_motion

_LARGEST = 0.3
"""Largest error of a signal, as a share of its amplitude: beyond some 0.5 the arc tangent loses a line."""


@dataclass(frozen=True)
class SinusoidalEncoder:
    """A position sensor of two sinusoidal tracks.

    Attributes:
        pitch: Motion per line [m or rad]; four counts of a quadrature.
        factor: Number of steps in a count of the quadrature; the paper plans 16 to 64.
        offset: Offsets of the sine and of the cosine, as shares of their amplitude.
        mismatch: m, ratio of the sine's amplitude to the cosine's, minus one.
        phase: Delta, lead of the sine beyond 90 degrees between the tracks [rad].
        harmonic: h, third harmonic of both tracks, as a share of their amplitude.

    Raises:
        ParameterError: If the pitch is not above 0, the factor no whole number above 0, or an error above 0.3.
    """

    pitch: float = 4 * PHANTOM_STEP
    factor: int = 64
    offset: tuple[float, float] = (0.0, 0.0)
    mismatch: float = 0.0
    phase: float = 0.0
    harmonic: float = 0.0

    def __post_init__(self) -> None:
        require_positive(pitch_of_the_encoder=self.pitch)
        require_whole(1, factor_of_the_interpolation=self.factor)
        errors = (*self.offset, self.mismatch, self.phase, self.harmonic)
        if len(self.offset) != 2 or not all(abs(error) <= _LARGEST for error in errors):
            raise ParameterError(
                f"Signal errors of {errors} were given for two offsets, amplitudes, phase and harmonic: give numbers "
                f"of at most {_LARGEST:g}, beyond which the interpolation may lose a line."
            )

    @property
    def step(self) -> float:
        """Motion per interpolated count [m or rad]."""
        return self.pitch / (4 * self.factor)

    def signals(self, position: Float[Array, " n"]) -> Float[Array, "2 n"]:
        """Sine and cosine track over their amplitude at the positions [m or rad], shape ``(2, n)``."""
        turn = 2 * math.pi / self.pitch * position
        ratio = math.sqrt(1.0 + self.mismatch)
        sine = ratio * np.sin(turn + self.phase) + self.harmonic * np.sin(3 * turn) + self.offset[0]
        cosine = np.cos(turn) / ratio - self.harmonic * np.cos(3 * turn) + self.offset[1]
        return np.stack([sine, cosine])

    def interpolated(self, position: Float[Array, " n"]) -> Float[Array, " n"]:
        """Position [m or rad] as lines and arc tangent give it, before it is rounded to steps, shape ``(n,)``."""
        sine, cosine = self.signals(position)
        line = 2 * math.pi / self.pitch
        # The electronics count lines: the arc tangent is unwrapped to the current line.
        error = np.angle(np.exp(1j * (np.arctan2(sine, cosine) - line * position)))
        return position + error / line


def record_sinusoidal(
    encoder: SinusoidalEncoder, position: Float[Array, " n"], *, interval: float, samples_apart: int
) -> EncoderRecord:
    """Interpolated counts of a motion and their edges, for every estimator of `velocity_estimators`.

    Args:
        encoder: The sensor.
        position: True position [m or rad] at equal intervals, shape ``(n,)``.
        interval: Time between two points [s]; the motion between them is less than a line.
        samples_apart: Number of points between two samples of the controller.

    Raises:
        ParameterError: As for `record_motion`, or if the motion passes a line between two points.
    """
    x = np.asarray(position, dtype=float)
    longest = float(np.max(np.abs(np.diff(x)), initial=0.0))
    if longest > encoder.pitch / 4:
        raise ParameterError(
            f"The motion passes {longest / encoder.pitch:.2g} lines of the encoder between two of its points: give "
            "points at most a quarter of a line apart."
        )
    return record_motion(Encoder(encoder.step), encoder.interpolated(x), interval=interval, samples_apart=samples_apart)
