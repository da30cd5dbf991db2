"""How large an effect is in a recording: the change of the torque residual over what the sensors leave.

The residual is the logged torque less what the true robot without the effect needs for the motion that the encoders
show. Of two runs with the same reference and noise, with and without the effect, its change is the effect's own trace.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import minimum_filter1d
from scipy.optimize import lsq_linear
from scipy.signal import butter, sosfiltfilt

from .dynamics import Chain, link_torque
from .records import LEAD, Recorder, band_of, measured
from .robots import FRICTION, INERTIA, ROTOR, Robot
from .simulate import STEP, Run

Array = np.ndarray
EVERY = 4  # steps of the simulation between two samples of a residual: no log has more, so that no noise folds back
GRID = EVERY * STEP
SLOW = 0.02  # of its top speed here, or of a third of its usual one: a slower joint counts as standing
CLEAR = 0.1  # from a stop or reversal to the first sample that counts [s]
EDGE = 0.3  # of the recording, at both ends: the filter's tails [s]
REACHED = 1.0 / 3.0  # of the largest gap: a joint beyond it is one that the effect reaches


@dataclass(frozen=True)
class View:
    """A motion and its torque in the judged band, on the grid.

    Attributes:
        q: Positions, shape ``(M, n)``; ``v`` and ``a`` their derivatives.
        tau: Drive torques.
        sign: Direction of motion, in the same band.
        rubbed: Dry friction as it acted, in the same band.
        moving: Whether a sample counts, shape ``(M, n)``.
    """

    q: Array
    v: Array
    a: Array
    tau: Array
    sign: Array
    rubbed: Array
    moving: Array

    def thin(self, step: int) -> View:
        """Every so many samples."""
        return View(*(getattr(self, name)[::step] for name in ("q", "v", "a", "tau", "sign", "rubbed", "moving")))


def _low(x: Array, high: float) -> Array:
    return sosfiltfilt(butter(4, high, fs=1.0 / GRID, output="sos"), x, axis=0)


def _view(q: Array, tau: Array, speed: Array, rubbed: Array, usual: Array, high: float) -> View:
    q = _low(q, high)
    v = np.gradient(q, GRID, axis=0)
    calm = np.abs(speed) > SLOW * np.maximum(np.abs(speed).max(axis=0), 0.3 * usual)
    calm = minimum_filter1d(calm.astype(np.uint8), 2 * round(CLEAR / GRID) + 1, axis=0).astype(bool)
    edge = round(EDGE / GRID)
    calm[:edge] = calm[-edge:] = False
    tau, sign, rubbed = (_low(x, high) for x in (tau, np.sign(speed), rubbed))
    return View(q, v, np.gradient(v, GRID, axis=0), tau, sign, rubbed, calm)


def _recorded(run: Run, count: int) -> tuple[Array, ...]:
    first = round(LEAD / STEP)
    return tuple(x[first : first + count * EVERY : EVERY] for x in (run.reading, run.command, run.speed, run.rubbed))


def _count(recorder: Recorder) -> int:
    return int(recorder.taken[-1] / GRID)


def seen(robot: Robot, run: Run, recorder: Recorder) -> View:
    """What a perfect recording of a run shows in the band of its log."""
    q, tau, speed, rubbed = _recorded(run, _count(recorder))
    return _view(q, tau, speed, rubbed, robot.each("speed"), band_of(recorder.rate))


def logged(robot: Robot, run: Run, recorder: Recorder, quantum: Array) -> View:
    """What the log of a run shows, put on the grid by cubic splines."""
    count = _count(recorder)
    q, tau = measured(run, recorder, quantum)
    rows = recorder.kept & (np.diff(recorder.stamp, prepend=-1.0) > 1e-6)
    grid = np.arange(count) * GRID
    splined = [CubicSpline(recorder.stamp[rows], x[rows])(grid) for x in (q, tau)]
    _, _, speed, rubbed = _recorded(run, count)
    return _view(splined[0], splined[1], speed, rubbed, robot.each("speed"), band_of(recorder.rate))


def residual(robot: Robot, view: View) -> Array:
    """Torque that the true robot without effects does not explain [N m or N], shape ``(M, n)``."""
    needed = link_torque(robot.true, view.q, view.v, view.a) + robot.true_rotor * view.a
    return view.tau - needed - robot.true_viscous * view.v - robot.true_coulomb * view.sign


def _rms(x: Array, where: Array) -> Array:
    count = where.sum(axis=0)
    square = np.where(where, x, 0.0) ** 2
    return np.where(count > 50, np.sqrt(square.sum(axis=0) / np.maximum(count, 1)), 0.0)


def noise_floor(robot: Robot, run: Run, recorder: Recorder, quantum: Array) -> Array:
    """What the sensors leave of each joint's torque in the band [N m or N], shape ``(n,)``.

    Friction is taken as it acted, so nothing but sensors and the torques that no log shows is left.
    """
    view = logged(robot, run, recorder, quantum)
    left = residual(robot, view) + robot.true_coulomb * view.sign + view.rubbed
    return np.maximum(_rms(left, view.moving), 1e-9)


@dataclass(frozen=True)
class Trace:
    """What an effect changes: in floors, at the samples where both runs move.

    Attributes:
        base: The run without it.
        change: Of the residual [N m or N], shape ``(M, n)``.
        moving: Where it counts.
        floor: Of each joint [N m or N].
    """

    base: View
    change: Array
    moving: Array
    floor: Array

    @property
    def each(self) -> Array:
        """Root mean square of each joint [noise floors]."""
        return _rms(self.change, self.moving) / self.floor

    @property
    def gap(self) -> float:
        """Root mean square over the joints that it reaches [noise floors]."""
        each = self.each
        return float(np.sqrt(np.mean(each[each >= REACHED * each.max()] ** 2)))


def trace(robot: Robot, without: View, view: View, floor: Array) -> Trace:
    """The change between two runs."""
    change = residual(robot, view) - residual(robot, without)
    return Trace(without, change, view.moving & without.moving, floor)


def rounding(run: Run, recorder: Recorder, fine: Array, coarse: Array, robot: Robot, floor: Array) -> Trace:
    """The trace of coarser encoders, which only the log shows."""
    without, view = logged(robot, run, recorder, fine), logged(robot, run, recorder, coarse)
    return trace(robot, without, view, floor)


def _changed(chain: Chain, field: str, link: int, value: Array | float) -> Chain:
    values = getattr(chain, field).copy()
    values[link] = value
    return replace(chain, **{field: values})


def tolerance_columns(robot: Robot, view: View) -> list[Array]:
    """What one sigma of each stated doubt does to the torques, each of shape ``(M, n)``."""
    chain, out = robot.true, []
    usual = link_torque(chain, view.q, view.v, view.a)

    def column(changed: Chain) -> Array:
        return link_torque(changed, view.q, view.v, view.a) - usual

    for k in range(chain.n):
        out += [
            column(_changed(chain, "mass", k, chain.mass[k] * (1.0 + INERTIA))),
            column(_changed(chain, "inertia", k, chain.inertia[k] * (1.0 + INERTIA))),
        ]
        far = INERTIA * np.linalg.norm(chain.center[k])
        out += [column(_changed(chain, "center", k, chain.center[k] + far * way)) for way in np.eye(3)]
        for level, shape in (
            (FRICTION * robot.true_coulomb[k], view.sign),
            (FRICTION * robot.true_viscous[k], view.v),
            (ROTOR * robot.true_rotor[k], view.a),
        ):
            one = np.zeros_like(usual)
            one[:, k] = level * shape[:, k]
            out.append(one)
    return out


def stacked(found: Trace, columns: list[Array], step: int) -> Array:
    """Columns in noise floors at the moving samples, every so many, shape ``(rows, len(columns))``."""
    where = found.moving[::step]
    return np.stack([(x / found.floor)[where] for x in columns], axis=1) if columns else np.zeros((where.sum(), 0))


def beyond_tolerance(robot: Robot, found: Trace) -> float:
    """What the model moved by two sigma at most leaves of a trace [noise floors, of the joints that it reaches]."""
    step = max(1, len(found.change) // 400)
    doubt = stacked(found, tolerance_columns(robot, found.base.thin(step)), step)
    change = stacked(found, [found.change[::step]], step)[:, 0]
    doubt = doubt[:, np.abs(doubt).max(axis=0) > 1e-6]
    left = change
    if doubt.shape[1]:
        fit = lsq_linear(doubt, change, bounds=(-2.0, 2.0), max_iter=60)
        left = change - doubt @ fit.x
    share = float(np.sqrt(np.mean(left**2) / max(np.mean(change**2), 1e-30)))
    return min(share, 1.0) * found.gap
