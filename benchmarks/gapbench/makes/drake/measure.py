"""What a run leaves in the drive torque, compared with another run of the same session: sizes in noise floors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import butter, sosfiltfilt

from .drive import passed
from .plant import Plant
from .robots import Robot
from .session import LEAD, Setup
from .simulate import Run

BAND = 20.0  # all sizes are of what lies below [Hz]
STILL = 0.004  # share of a joint's speed below which dry friction may take any value up to its level


@dataclass(frozen=True)
class Even:
    """A run on an even clock; arrays of shape ``(N, n)``."""

    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    speed: np.ndarray
    torque: np.ndarray


def smoothed(x: np.ndarray, rate: float, corner: float) -> np.ndarray:
    """Low-passed without delay; what lies above the corner is gone, what lies below is kept."""
    return sosfiltfilt(butter(4, corner, fs=rate, output="sos"), x, axis=0)


def held_mean(t: np.ndarray, held: np.ndarray, at: np.ndarray, width: float) -> np.ndarray:
    """Mean of a held signal over a window about each time: ``held[k]`` acts from ``t[k]`` to ``t[k + 1]``."""
    area = np.vstack([np.zeros(held.shape[1]), np.cumsum(np.diff(t)[:, None] * held[:-1], axis=0)])
    columns = [np.interp(at + 0.5 * width, t, x) - np.interp(at - 0.5 * width, t, x) for x in area.T]
    return np.stack(columns, axis=1) / width


def on_even_clock(run: Run, rate: float, noise: np.ndarray, readings: np.ndarray) -> Even:
    """The run as readings show it, with the torque that the drives were asked for and the noise they added.

    Args:
        rate: Of the clock [Hz].
        noise: Held like the command [N m], shape ``(N, n)``.
        readings: Of the joints at the ticks, shape ``(N, n)``.
    """
    clock = np.arange(run.t[0] + 2.0 / rate, run.t[-1] - 2.0 / rate, 1.0 / rate)
    q = CubicSpline(run.t, readings)(clock)
    # Twice a spline's first derivative: right to the fourth order, where differences lose some percent at 20 Hz.
    v = CubicSpline(clock, q)(clock, 1)
    a = CubicSpline(clock, v)(clock, 1)
    torque = held_mean(run.t, run.command + noise, clock, 1.0 / rate)
    return Even(clock, q, v, a, CubicSpline(run.t, run.speed)(clock), torque)


def rigid_torque(robot: Robot, plant: Plant, run: Even) -> np.ndarray:
    """What links, rotors and viscous friction need for the motion that the encoders show [N m]."""
    return plant.torque(run.q, run.v, run.a) + robot.array("rotor") * run.a + robot.array("wet") * run.v


def mean_sign(speed: np.ndarray) -> np.ndarray:
    """Sign of a speed, averaged over each sample: a reversal between two samples is shared out to both."""
    half = 0.5 * np.abs(np.gradient(speed, axis=0))
    return np.clip(speed / np.maximum(half, 1e-12), -1.0, 1.0)


def dry_friction(robot: Robot, run: Even, asked: np.ndarray) -> np.ndarray:
    """Coulomb friction; where a joint stands still it takes what is asked of it, up to its level [N m].

    Args:
        asked: What the torque is beyond all else [N m].
    """
    level = robot.array("dry")
    still = np.abs(run.speed) < STILL * robot.array("speed")
    return np.where(still, np.clip(asked, -level, level), level * mean_sign(run.speed))


def residual(robot: Robot, plant: Plant, run: Even, rate: float) -> np.ndarray:
    """Torque less what the true robot with its modelled friction needs, below `BAND` [N m], shape ``(N, n)``."""
    asked = run.torque - rigid_torque(robot, plant, run)
    left = smoothed(asked - dry_friction(robot, run, asked), rate, BAND)
    ends = int(np.ceil(LEAD * rate))
    return left[ends:-ends]


def rms(x: np.ndarray) -> np.ndarray:
    """Root mean square over time, shape ``(n,)``."""
    return np.sqrt((x**2).mean(axis=0))


@dataclass(frozen=True)
class Ruler:
    """Measures runs of a session against the run of the robot that is as its true parameters say.

    Attributes:
        setup: Of both runs.
        plant: The true robot in Drake.
        base: Run without any effect, on the even clock.
        left: Its residual, noise and counts taken out [N m]: bristles and current loops of a null.
        floor: What noise and encoder counts leave per joint [N m], shape ``(n,)``.
        fine: What bristles and current loops leave per joint [noise floors], shape ``(n,)``.
        loop: What current loops alone leave [noise floors], shape ``(n,)``.
    """

    setup: Setup
    plant: Plant
    base: Even
    left: np.ndarray
    floor: np.ndarray
    fine: np.ndarray
    loop: np.ndarray

    def change(self, run: Run) -> np.ndarray:
        """Paired difference [noise floors], shape ``(N, n)``."""
        # Before counts are rounded: the two runs differ in theirs by chance, which is no effect.
        even = on_even_clock(run, self.setup.rate, self.setup.session.noise, run.shown)
        return (residual(self.setup.truth, self.plant, even, self.setup.rate) - self.left) / self.floor


def lag_of_loops(run: Run, time: np.ndarray) -> np.ndarray:
    """What first-order current loops give less than was asked, held from tick to tick [N m], shape ``(N, n)``.

    Args:
        time: Their time constants [s], shape ``(n,)``.
    """
    out, state = np.zeros_like(run.command), run.command[0]
    for k, period in enumerate(np.diff(run.t)):
        mean, state = passed(state, run.command[k], time, period)
        out[k] = run.command[k] - mean
    return out


def ruler(setup: Setup, run: Run) -> Ruler:
    """Floors of a session, from its run without any effect."""
    plant, rate, truth = Plant(setup.truth), setup.rate, setup.truth
    noise = setup.session.noise
    base = on_even_clock(run, rate, noise, run.shown)
    read = on_even_clock(run, rate, noise, run.reading)
    left = residual(truth, plant, base, rate)
    counts = smoothed(rigid_torque(truth, plant, read) - rigid_torque(truth, plant, base), rate, BAND)
    ends = int(np.ceil(LEAD * rate))
    alone = smoothed(held_mean(run.t, noise, base.t, 1.0 / rate), rate, BAND)
    floor = np.hypot(rms(alone[ends:-ends]), rms(counts[ends:-ends]))
    lag = lag_of_loops(run, setup.session.fine.loop)
    lag = smoothed(held_mean(run.t, lag, base.t, 1.0 / rate), rate, BAND)[ends:-ends]
    return Ruler(setup, plant, base, left, floor, rms(left) / floor, rms(lag) / floor)


def size_of(change: np.ndarray) -> float:
    """Root mean square of a paired difference over time and the joints that it reaches [noise floors].

    A joint is reached where it changes by a tenth of the most that any joint changes.
    """
    each = rms(change)
    return float(np.sqrt((each[each >= 0.1 * each.max()] ** 2).mean())) if each.max() > 0.0 else 0.0
