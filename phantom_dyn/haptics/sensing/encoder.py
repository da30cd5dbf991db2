r"""Simulates encoders that a controller samples: incremental ones (counts and times of edges) and sinusoidal ones.

**Incremental.** The continuous motion is given as a polyline finer than the sampling period. An edge is half-way
between two counts, displaced by `spacing`, which repeats every four edges (the period of the two quadrature tracks).

**Sinusoidal.** Two tracks give a sine and a cosine of :math:`\varphi = 2\pi x / p` with pitch p, and the arc tangent of
both interpolates within the pitch. Offsets :math:`o`, unequal amplitudes (ratio :math:`1 + m`), a phase error between
the tracks (:math:`\delta`) and saturation of the signals (third harmonic :math:`h`) cause an error with the period p,

.. math:: \frac{2\pi}{p} (\hat x - x) \approx o_s \cos\varphi - o_c \sin\varphi + \frac{m}{2} \sin 2\varphi
   + \frac{\delta}{2} (1 + \cos 2\varphi) + h \sin 4\varphi

to first order. At a speed v the velocity has a ripple of :math:`o\,v`, :math:`m\,v`, :math:`\delta\,v` and
:math:`4 h\,v`, which finer steps do not remove. Estimators treat the interpolated counts and edges as those of a finer
incremental encoder.

References:
    Cavusoglu, Feygin and Tendick (2002, section 7) planned sinusoidal encoders with 16 to 64 times finer steps, and
    state no errors. The expansion is derived here; tests compare it with the arc tangent.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from phantom_dyn._kernels.jit import jit
from phantom_dyn.array_types import Array, Float, Int
from phantom_dyn.errors import ParameterError
from phantom_dyn.number_checks import require_positive, require_whole

PHANTOM_STEP = 0.03e-3
"""Position precision of the PHANToM 1.5 at the centre of the workspace [m] (Cavusoglu 2002, section 4.1.2)."""
# Largest number of edges of one recording, each of which needs 32 bytes.
_MOST_EDGES = 2e7


@dataclass(frozen=True)
class Encoder:
    """Resolution of a position sensor.

    Attributes:
        step: Motion per count [m or rad].
        spacing: Displacements of the four edges of a quadrature period [steps], each in (-0.25, 0.25).

    Raises:
        ParameterError: If the step is not positive, or displacements may change the order of edges.
    """

    step: float = PHANTOM_STEP
    spacing: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        require_positive("the encoder", step=self.step)
        if len(self.spacing) != 4 or not all(abs(part) < 0.25 for part in self.spacing):
            raise ParameterError(
                f"The spacing errors of the encoder are {self.spacing}: give four shares of a step in (-0.25, 0.25)."
            )


@dataclass(frozen=True)
class EncoderRecord:
    """Counts and edges of an encoder during a motion.

    Attributes:
        period: Sampling period of the controller [s].
        step: Motion per count [m or rad].
        counts: Count at each sample k, taken at time k * period, shape ``(N,)``.
        edge_time: Times of all edges [s], shape ``(E,)``.
        edge_direction: +1 or -1 for each edge, shape ``(E,)``.
    """

    period: float
    step: float
    counts: Int[Array, " N"]
    edge_time: Float[Array, " E"]
    edge_direction: Float[Array, " E"]

    @cached_property
    def reading(self) -> Float[Array, " N"]:
        """Position according to the count at each sample [m or rad], shape ``(N,)``."""
        return self.counts * self.step


def record_motion(
    encoder: Encoder, position: Float[Array, " n"], *, interval: float, samples_apart: int
) -> EncoderRecord:
    """Counts and edge times of a motion that is linear between its points.

    Args:
        encoder: The sensor.
        position: True position [m or rad] at equal intervals, shape ``(n,)``.
        interval: Time between two points [s].
        samples_apart: Number of points between two samples of the controller.

    Raises:
        ParameterError: If there are fewer than two samples, a position is not finite, the interval is not above 0, or
            the motion passes too many edges.
    """
    require_positive(interval=interval)
    require_whole(1, samples_apart=samples_apart)
    if position.size <= samples_apart:
        raise ParameterError(
            f"{position.size} points with {samples_apart} to a sample are less than two samples: give a longer motion."
        )
    if not np.isfinite(position).all():
        raise ParameterError("The motion holds a position that is not finite: give numbers only.")
    x = np.ascontiguousarray(position, dtype=np.float64)
    spacing = np.array(encoder.spacing)
    # An interval passes at most one edge more than its length in steps.
    passed = float(np.sum(np.abs(np.diff(x)))) / encoder.step
    if passed > _MOST_EDGES:
        raise ParameterError(
            f"The motion passes {passed:.3g} edges of {encoder.step:g} each, more than the {_MOST_EDGES:.0g} that are "
            "kept: give a coarser encoder or a shorter motion."
        )
    capacity = int(2 * passed) + x.size + 8
    counts = np.zeros((x.size - 1) // samples_apart + 1, dtype=np.int64)
    times, directions = np.zeros(capacity), np.zeros(capacity)
    used = follow_motion(x, interval, samples_apart, encoder.step, spacing, counts, times, directions)
    return EncoderRecord(interval * samples_apart, encoder.step, counts, times[:used], directions[:used])


@jit
def follow_motion(x, dt, per_sample, step, spacing, counts, times, directions):
    """Write counts at every ``per_sample``-th point of a polyline, and its edges; returns the number of edges."""
    count = int(np.floor(x[0] / step + 0.5))
    count, _ = count_through(count, 0.0, x[0], 0.0, x[0], step, spacing, times, directions, 0)
    counts[0] = count
    used = 0
    for i in range(1, x.size):
        count, used = count_through(count, (i - 1) * dt, x[i - 1], i * dt, x[i], step, spacing, times, directions, used)
        if i % per_sample == 0:
            counts[i // per_sample] = count
    return used


@jit
def count_through(count, t0, x0, t1, x1, step, spacing, times, directions, used):
    """Write the edges of a linear motion from (t0, x0) to (t1, x1) from index ``used`` on; returns count and index.

    ``times`` may be a ring buffer, in which new edges overwrite the oldest ones.
    """
    while x1 >= edge_position(count + 1, step, spacing):
        level = edge_position(count + 1, step, spacing)
        times[used % times.size] = t0 + (t1 - t0) * min(max((level - x0) / (x1 - x0), 0.0), 1.0) if x1 > x0 else t0
        directions[used % times.size] = 1.0
        used += 1
        count += 1
    while x1 < edge_position(count, step, spacing):
        level = edge_position(count, step, spacing)
        times[used % times.size] = t0 + (t1 - t0) * min(max((level - x0) / (x1 - x0), 0.0), 1.0) if x1 < x0 else t0
        directions[used % times.size] = -1.0
        used += 1
        count -= 1
    return count, used


@jit
def edge_position(count, step, spacing):
    """Position of the edge between a count and the count below it."""
    return (count - 0.5 + spacing[count % 4]) * step


# Largest error of a signal, as a share of its amplitude; above about 0.5 the arc tangent would miscount lines.
_LARGEST = 0.3


@dataclass(frozen=True)
class SinusoidalEncoder:
    """A position sensor of two sinusoidal tracks.

    Attributes:
        pitch: Motion per line [m or rad], which has four counts of a quadrature.
        factor: Number of steps per count of the quadrature; the paper plans 16 to 64.
        offset: Offsets of the sine and of the cosine, as shares of their amplitude.
        mismatch: m, ratio of the sine's amplitude to the cosine's, minus one.
        phase: Delta, lead of the sine beyond the 90 degrees between the tracks [rad].
        harmonic: h, third harmonic of both tracks, as a share of their amplitude.

    Raises:
        ParameterError: If the pitch is not above 0, the factor is not a whole number above 0, or an error exceeds 0.3.
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
        """Sine and cosine tracks, relative to their amplitude, at the positions [m or rad], shape ``(2, n)``."""
        turn = 2 * math.pi / self.pitch * position
        ratio = math.sqrt(1.0 + self.mismatch)
        sine = ratio * np.sin(turn + self.phase) + self.harmonic * np.sin(3 * turn) + self.offset[0]
        cosine = np.cos(turn) / ratio - self.harmonic * np.cos(3 * turn) + self.offset[1]
        return np.stack([sine, cosine])

    def interpolated(self, position: Float[Array, " n"]) -> Float[Array, " n"]:
        """Position [m or rad] from lines and arc tangent before rounding to steps, shape ``(n,)``."""
        sine, cosine = self.signals(position)
        line = 2 * math.pi / self.pitch
        # The electronics count lines, so that the arc tangent is unwrapped to the current line.
        error = np.angle(np.exp(1j * (np.arctan2(sine, cosine) - line * position)))
        return position + error / line


def record_sinusoidal(
    encoder: SinusoidalEncoder, position: Float[Array, " n"], *, interval: float, samples_apart: int
) -> EncoderRecord:
    """Interpolated counts and edges of a motion, for the estimators of `velocity_estimators`.

    Args:
        encoder: The sensor.
        position: True position [m or rad] at equal intervals, shape ``(n,)``.
        interval: Time between two points [s]; the motion in it must be less than a quarter of a line.
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
