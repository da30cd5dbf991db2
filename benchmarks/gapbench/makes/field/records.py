"""Logs as people get them: uneven stamps, lost and repeated rows, rounded positions, noisy torques, several formats."""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from scipy.signal import lfilter

from .robots import Robot
from .simulate import STEP, Run

Array = np.ndarray
Rng = np.random.Generator
FORMATS = ("csv", "csv", "parquet", "npz")
NOISE = (0.01, 0.03)  # of the torque of the motion, in the judged band; drawn evenly in the logarithm
HIGHEST = 10.0  # end of the judged band [Hz]: beyond it these motions hold little but noise
LEAD = 0.5  # what passes before the recording starts: the robot settles [s]


@dataclass(frozen=True)
class Recorder:
    """How a log is taken, the same with and without an effect.

    Attributes:
        taken: True time of each row [s], shape ``(N,)``; ``stamp`` is what the log says.
        rate: Nominal rate [Hz].
        noise: Added to the torques [N m or N], shape ``(N, n)``.
        kept: False where a row was lost, shape ``(N,)``; ``twice``: rows that are written twice.
        speeds: The log has velocities, by differences of its positions.
        references: It has the controller's references.
        constants: Torque constant and gear ratio of each joint where it has currents, else empty.
        ending: File format.
    """

    taken: Array
    stamp: Array
    rate: float
    noise: Array
    kept: Array
    twice: Array
    speeds: bool
    references: bool
    constants: dict[str, tuple[float, float]]
    ending: str


def coloured(rng: Rng, steps: int, level: Array, corner: float, rate: float) -> Array:
    """Noise of a given deviation that is low-passed at a corner [Hz], shape ``(steps, n)``."""
    keep = np.exp(-2.0 * np.pi * corner / rate)
    start = rng.standard_normal((1, len(level)))
    white = np.concatenate([start, np.sqrt(1.0 - keep**2) * rng.standard_normal((steps - 1, len(level)))])
    return level * lfilter([1.0], [1.0, -keep], white, axis=0)


def band_of(rate: float) -> float:
    """Highest frequency that is judged [Hz] in a log of a rate [Hz]."""
    return min(HIGHEST, 0.1 * rate)


def torque_noise(rng: Rng, steps: int, torque: Array, rate: float, band: float) -> Array:
    """White and coloured noise of drives or sensors, in equal parts within the judged band, shape ``(steps, n)``.

    Args:
        rng: Source of chance.
        steps: How many.
        torque: Root mean square of each joint's torque [N m or N], shape ``(n,)``.
        rate: Of the steps [Hz].
        band: Edge of the judged band [Hz].
    """
    level = torque * np.exp(rng.uniform(np.log(NOISE[0]), np.log(NOISE[1]), len(torque)))
    white = np.sqrt(0.5 * rate / (2.0 * band)) * level * rng.standard_normal((steps, len(torque)))
    return white + coloured(rng, steps, np.sqrt(0.5) * level, np.exp(rng.uniform(np.log(4.0), np.log(40.0))), rate)


def draw_recorder(robot: Robot, seconds: float, torque: Array, *, in_sensor: bool, rng: Rng) -> Recorder:
    """Draws how the log is taken.

    Args:
        robot: What is recorded.
        seconds: Length of the run [s].
        torque: Root mean square of each drive torque [N m or N], shape ``(n,)``.
        in_sensor: The torques are measured, and their noise moves nothing.
        rng: Source of chance.
    """
    rate = float(rng.choice(robot.kind.rates))
    count = int((seconds - LEAD - 0.02) * rate)
    even = LEAD + np.arange(count) / rate
    jitter = float(rng.choice((0.0, 0.02, 0.08)))
    taken = even + jitter / rate * np.clip(rng.standard_normal(count), -3.0, 3.0)
    stamp = taken + float(rng.choice((0.0, 2e-5, 1e-4))) * np.clip(rng.standard_normal(count), -2.0, 2.0)
    stamp = np.maximum.accumulate(stamp + np.arange(count) * 1e-9)
    noise = torque_noise(rng, count, torque, rate, band_of(rate)) * float(in_sensor)
    lost = float(rng.choice((0.0, 0.0, 0.002, 0.01)))
    kept, twice = rng.random(count) >= lost, rng.random(count) < float(rng.choice((0.0, 0.0, 0.003)))
    constants = {}
    if in_sensor and rng.random() < 0.5:
        gears = rng.choice((50.0, 80.0, 100.0, 120.0), len(torque))
        constants = {
            name: (float(f"{most / gear / 5.0:.3g}"), float(gear))
            for name, most, gear in zip(robot.names, torque, gears, strict=True)
        }
    return Recorder(
        taken=taken - LEAD,
        stamp=stamp - LEAD,
        rate=rate,
        noise=noise,
        kept=kept,
        twice=twice,
        speeds=bool(rng.random() < 0.5),
        references=bool(rng.random() < 0.5),
        constants=constants,
        ending=str(rng.choice(FORMATS)),
    )


def at_times(values: Array, times: Array) -> Array:
    """Values of the simulation's steps at any times [s], linear between two steps."""
    place = np.asarray(times) / STEP
    first = np.clip(place.astype(int), 0, len(values) - 2)
    share = (place - first)[:, None]
    return values[first] * (1.0 - share) + values[first + 1] * share


def measured(run: Run, recorder: Recorder, quantum: Array) -> tuple[Array, Array]:
    """Positions as the encoders give them and torques as the drives tell them, each of shape ``(N, n)``."""
    times = recorder.taken + LEAD
    return (
        np.round(at_times(run.reading, times) / quantum) * quantum,
        at_times(run.command, times) + recorder.noise,
    )


def columns(robot: Robot, run: Run, ref: Array, recorder: Recorder, quantum: Array) -> dict[str, Array]:
    """The log, column by column."""
    q, tau = measured(run, recorder, quantum)
    wanted = at_times(ref, recorder.taken + LEAD)
    rows = np.flatnonzero(recorder.kept)
    rows = np.repeat(rows, 1 + recorder.twice[rows])
    slope = np.diff(q, axis=0, prepend=q[:1]) / np.diff(recorder.stamp, prepend=recorder.stamp[0] - 1.0)[:, None]
    out = {"t": recorder.stamp[rows]}
    for j, name in enumerate(robot.names):
        out[f"q.{name}"] = q[rows, j]
        if recorder.speeds:
            out[f"v.{name}"] = slope[rows, j]
        if recorder.constants:
            constant, gear = recorder.constants[name]
            out[f"i.{name}"] = tau[rows, j] / (constant * gear)
        else:
            out[f"tau.{name}"] = tau[rows, j]
        if recorder.references:
            out[f"q_ref.{name}"] = wanted[rows, j]
    return out


def written(log: Mapping[str, Array], ending: str) -> bytes:
    """The log as a file of the format."""
    place = io.BytesIO()
    if ending == "csv":
        np.savetxt(
            place, np.column_stack(list(log.values())), fmt="%.10g", delimiter=",", header=",".join(log), comments=""
        )
    elif ending == "parquet":
        pq.write_table(pa.table(dict(log)), place)
    else:
        np.savez(place, **log)  # type: ignore[arg-type]  # its stub takes the names of columns for options
    return place.getvalue()
