"""Estimates a drive's position controller by regression of its logged output on the position error.

A drive with its own position controller has the output ``y = gain (q_ref(t - delay) - q) + offset``, clipped. If the
recording has this output (voltage, share of the supply, current or torque), gain, limit, dead band, delay and hold of
the reference are estimated without a model of the robot. Rows at the limit are left out of the regression. An output
that equals this law up to rounding was computed and not measured. Such an output does not show the drive's delay.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phantom_dyn.array_types import Array, Bool, Float

# Longest delay of the reference that is tried [s], and number of delays per step of the recording.
_LONGEST, _PER_STEP = 0.2, 4
# Smallest number of rows, and number of stretches of which the jackknife leaves out one at a time.
_FEWEST, _STRETCHES = 100, 10
# Share of the output's variance that the loop has to explain.
_EXPLAINED = 0.9
# Rows are at the limit if they differ from the largest output by at most the share `_AT_LIMIT`, because a supply varies
# by a per cent. A limit is accepted if at least the share `_SHARE_AT_LIMIT` of all rows is at the limit.
_AT_LIMIT, _SHARE_AT_LIMIT = 0.015, 0.01
# An output without delay counts as computed if the rms of its residual is at most this share of the output's rms.
# Rounding and variations of the supply are below this share; measured drives have 5 to 10 %.
_ROUNDING = 0.015
# Rows with a residual of more than `_OUTLIER` robust standard deviations are outliers. They are removed if they are at
# most the share `_MOST_OUTLIERS` of the rows.
_OUTLIER, _MOST_OUTLIERS = 6.0, 0.02
# There may be a dead band if at least this share of the rows has an output of zero.
_SILENT = 0.02
# A reference is held for longer than a sample if, while it moves, more than this share of its samples are repeated.
_REPEATED = 0.3
# Some drives reduce their output beyond a certain position error, to protect themselves. Such a drop is accepted if the
# reduced output is below the share `_DROPPED` of gain times error, if more than the share `_SHARE_DROPPED` of the rows
# is reduced, and if the drop makes the squared residual smaller than the share `_TWO_LEVELS` of that without a drop.
_DROPPED, _SHARE_DROPPED, _TWO_LEVELS = 0.7, 0.01, 0.3
# Number of rows for a first estimate of the delay.
_ROWS_OF_DELAY = 4000
# Number of rows in which a drop is searched for. A position that differs from both its neighbours by more than `_JUMP`
# median steps is a wrong reading.
_ROWS_OF_DROP, _JUMP = 4000, 10.0
# Half width, in standard deviations, of the interval of an estimated delay.
_INTERVAL_STDS = 3.0


@dataclass(frozen=True)
class DriveLoop:
    """Estimated parameters of one drive's position controller; standard deviations are from a jackknife over time.

    Attributes:
        output: Quantity that was logged: ``u``, ``duty``, ``i`` or ``tau``.
        gain: Output per position error [V/rad, 1/rad, A/rad or N m/rad; per m of a linear joint].
        gain_std: Standard deviation of the gain.
        delay: Time [s] by which the reference arrives later than it is recorded.
        delay_std: Standard deviation of the delay.
        limit: Largest output, at which it is clipped; None if it is never clipped.
        at_limit: Share of the rows that are clipped.
        dead_band: Position error [rad or m] below which there is no output; None if there is no dead band.
        hold: Time [s] for which a reference is held, if longer than a sample; else None.
        residual_rms: Rms of the output's residual, in rows that are not clipped.
        computed: True if the output equals the controller's law up to rounding: it was computed and not measured.
        drops_beyond: Position error [rad or m] beyond which the drive reduces its output to protect itself; infinite if
            it does not.
        drops_to: Size of the output beyond ``drops_beyond``.
        dropped: Share of the rows with an error beyond ``drops_beyond``.
    """

    output: str
    gain: float
    gain_std: float
    delay: float
    delay_std: float
    limit: float | None
    at_limit: float
    dead_band: float | None
    hold: float | None
    residual_rms: float
    computed: bool
    drops_beyond: float = np.inf
    drops_to: float = np.inf
    dropped: float = 0.0

    def output_at(self, error: Float[Array, " N"]) -> Float[Array, " N"]:
        """Output at the given position errors [rad or m], with limit and drop, and without an offset."""
        limit = np.inf if self.limit is None else self.limit
        most = np.where(np.abs(error) > self.drops_beyond, min(self.drops_to, limit), limit)
        return np.clip(self.gain * error, -most, most)


def drive_loop(
    output: str, t: Float[Array, " N"], y: Float[Array, " N"], q_ref: Float[Array, " N"], q: Float[Array, " N"]
) -> DriveLoop | None:
    """The position controller of one drive; None if its output does not follow the position error.

    Args:
        output: Name of the quantity: ``u``, ``duty``, ``i`` or ``tau``.
        t: Times [s].
        y: Output of the drive.
        q_ref: References as recorded [rad or m].
        q: Measured positions [rad or m].
    """
    finite = np.isfinite(y) & np.isfinite(q_ref) & np.isfinite(q)
    if finite.sum() < _FEWEST or not np.ptp(y[finite]) > 0 or not np.ptp(q_ref[finite]) > 0:
        return None
    limit, clipped = _clipping(y, finite)
    step = float(np.median(np.diff(t)))
    delays = np.arange(0.0, _LONGEST, step / _PER_STEP)
    drop = _drop(t, y, q_ref, q, finite & ~clipped & ~_isolated(q), delays[::_PER_STEP])
    dropped = np.zeros(len(y), dtype=bool) if drop is None else _beyond(t, q_ref, q, *drop)
    use = _without_outliers(t, y, q_ref, q, finite & ~clipped & ~dropped, delays, np.inf if limit is None else limit)
    # If the fitted controller asks for no more than the output there, the rows at the limit are only peaks.
    if limit is not None and not _exceeds_limit(t, y, q_ref, q, use, clipped, delays):
        limit, clipped = None, np.zeros(len(y), dtype=bool)
        use = _without_outliers(t, y, q_ref, q, finite & ~dropped, delays, np.inf)
    if use.sum() < _FEWEST:
        return None
    # The fine delays within two steps of the best coarse delay.
    coarse_best = _coarse_best(t, y, q_ref, q, use, delays[::_PER_STEP])
    delays = delays[_neighbours(_PER_STEP * coarse_best, 2 * _PER_STEP)]
    errors = _errors(t, q_ref, q, delays)
    sums = _sums(errors, y, use)
    gain, delay, residual_rms = _best(sums.sum(axis=0), delays)
    if gain <= 0 or residual_rms > np.sqrt(1.0 - _EXPLAINED) * float(np.std(y[use])):
        return None
    # Jackknife: gain and delay without one stretch at a time.
    without_one = np.array([_best(sums.sum(axis=0) - part, delays)[:2] for part in sums])
    gain_std, delay_std = np.sqrt((_STRETCHES - 1) * np.var(without_one, axis=0))
    # The deviation is at least that of a delay that is uniformly distributed between two grid points.
    delay_std = max(delay_std, step / _PER_STEP / np.sqrt(12))
    size = float(np.sqrt(np.mean(y[use] ** 2)))
    computed = delay < step / _PER_STEP and residual_rms <= max(_ROUNDING * size, _quantum(y[use]))
    return DriveLoop(
        output=output,
        gain=gain,
        gain_std=float(gain_std),
        delay=0.0 if computed else delay,
        delay_std=float(delay_std),
        limit=limit,
        at_limit=float(clipped.sum() / finite.sum()),
        dead_band=_dead_band(y[use], errors[use, int(np.argmin(np.abs(delays - delay)))]),
        hold=_hold(t, q_ref, step),
        residual_rms=residual_rms,
        computed=computed,
        drops_beyond=np.inf if drop is None else drop[1],
        drops_to=np.inf if drop is None else float(np.median(np.abs(y[finite & dropped]))),
        dropped=float((finite & dropped).sum() / finite.sum()),
    )


def _isolated(q: Float[Array, " N"]) -> Bool[Array, " N"]:
    """True for rows with a wrong reading, whose position is far from both its neighbours."""
    away = np.minimum(np.abs(np.diff(q, prepend=q[:1])), np.abs(np.diff(q, append=q[-1:])))
    return away > _JUMP * max(float(np.median(np.abs(np.diff(q)))), 1e-12)


def _drop(
    t: Array, y: Array, q_ref: Array, q: Array, use: Bool[Array, " N"], delays: Float[Array, " d"]
) -> tuple[float, float] | None:
    """Delay of the references [s], and position error [rad or m] beyond which a drive reduces its output, or None.

    The output is modelled as a function of the absolute error: a line through the origin up to the drop, and a constant
    beyond it. Every error in the data is tried as the drop. With rows sorted by error, cumulative sums give the squared
    residual of both parts.
    """
    rows = np.flatnonzero(use)
    rows = rows[:: max(len(rows) // _ROWS_OF_DROP, 1)]
    least, best = np.inf, None
    for delay in delays:
        error = np.interp(t[rows] - delay, t, q_ref) - q[rows]
        order = np.argsort(np.abs(error))
        # Size of the error, and output in the direction of the error.
        e, z = np.abs(error)[order], (y[rows] * np.sign(error))[order]
        sum_ee, sum_ez, sum_zz, sum_z = (np.cumsum(x) for x in (e * e, e * z, z * z, z))
        count_beyond, sum_beyond = np.arange(len(e) - 1, 0, -1), sum_z[-1] - sum_z[:-1]
        gain, level = sum_ez[:-1] / np.maximum(sum_ee[:-1], 1e-300), sum_beyond / count_beyond
        squares = sum_zz[-1] - gain * sum_ez[:-1] - level * sum_beyond
        dropped = (level < _DROPPED * gain * e[:-1]) & (count_beyond > _SHARE_DROPPED * len(e))
        squares = np.where(dropped, squares, np.inf)
        without_drop = sum_zz[-1] - sum_ez[-1] ** 2 / max(sum_ee[-1], 1e-300)
        k = int(np.argmin(squares))
        if squares[k] < min(least, _TWO_LEVELS * without_drop):
            least, best = float(squares[k]), (float(delay), float(0.5 * (e[k] + e[k + 1])))
    if best is None:
        return None
    # A real drop lasts for several rows, a wrong reading for one.
    dropped = use & _beyond(t, q_ref, q, *best)
    return best if 2 * int(np.sum(dropped[1:] & dropped[:-1])) > dropped.sum() else None


def _beyond(t: Array, q_ref: Array, q: Array, delay: float, error: float) -> Bool[Array, " N"]:
    """True for rows whose absolute position error is larger than ``error``, with references ``delay`` seconds late."""
    return np.abs(np.interp(t - delay, t, q_ref) - q) > error


def delay_intervals(
    loops: tuple[DriveLoop | None, ...], nv: int, frame: float = 0.0
) -> tuple[Float[Array, " nv"], Float[Array, " nv"]]:
    """Smallest and largest delay of each joint's reference [s] that agrees with the estimated controller.

    They are zero and infinity for a joint without an estimate, and for a joint whose output was computed, because such
    an output does not show the delay.

    Args:
        loops: Estimated controller of each joint; may be empty.
        nv: Number of joints.
        frame: Time [s] for which a reference is held: it may have arrived up to this time before the sample.
    """
    least, most = np.zeros(nv), np.full(nv, np.inf)
    for j, loop in enumerate(loops):
        if loop is not None and not loop.computed:
            width = _INTERVAL_STDS * loop.delay_std
            least[j], most[j] = max(loop.delay - width - frame, 0.0), loop.delay + width
    return least, most


def _clipping(y: Float[Array, " N"], finite: Bool[Array, " N"]) -> tuple[float | None, Bool[Array, " N"]]:
    """Limit of the output, and True for rows at the limit; None and no rows if the largest outputs are only peaks."""
    largest = float(np.abs(y[finite]).max())
    # Rows at a limit come in runs, peaks do not: pairs of neighbouring rows are counted.
    at_limit = finite & (np.abs(y) >= (1.0 - _AT_LIMIT) * largest)
    pairs = int(np.sum(at_limit[1:] & at_limit[:-1]))
    if at_limit.sum() < _SHARE_AT_LIMIT * finite.sum() or pairs < 0.5 * at_limit.sum():
        return None, np.zeros(len(y), dtype=bool)
    return float(np.median(np.abs(y[at_limit]))), at_limit


def _exceeds_limit(
    t: Array, y: Array, q_ref: Array, q: Array, use: Bool[Array, " N"], clipped: Bool[Array, " N"], delays: Array
) -> bool:
    """True if the fitted controller asks for more than the logged output in the rows that count as clipped.

    If these rows are only peaks, the controller asks for no more than the output.
    """
    if use.sum() < _FEWEST:  # too few for a fit, so that the limit is kept
        return True
    commanded = _commanded(t, y, q_ref, q, use, delays)
    return bool(np.median(commanded[clipped] / y[clipped]) > 1.0 + _AT_LIMIT)


def _without_outliers(
    t: Array, y: Array, q_ref: Array, q: Array, use: Bool[Array, " N"], delays: Float[Array, " d"], limit: float
) -> Bool[Array, " N"]:
    """True for used rows in which the controller asks for less than the limit, and the output is no outlier."""
    for _ in range(3):
        commanded = _commanded(t, y, q_ref, q, use, delays)
        within = use & (np.abs(commanded) < (1.0 - 2 * _AT_LIMIT) * limit)
        use = within if within.sum() >= _FEWEST else use
        away = np.abs(y - commanded - np.median((y - commanded)[use]))
        bad = use & (away > _OUTLIER * 1.4826 * max(float(np.median(away[use])), 1e-12))
        if bad.sum() <= _MOST_OUTLIERS * use.sum():
            use = use & ~bad
    return use


def _commanded(
    t: Array, y: Array, q_ref: Array, q: Array, use: Bool[Array, " N"], delays: Float[Array, " d"]
) -> Float[Array, " N"]:
    """Output that the controller asks for, without its offset, with gain and delay by least squares."""
    coarse = delays[::_PER_STEP]
    coarse = coarse[_neighbours(_coarse_best(t, y, q_ref, q, use, coarse), 1)]
    errors = _errors(t, q_ref, q, coarse)
    gain, delay, _ = _best(_sums(errors, y, use).sum(axis=0), coarse)
    return gain * (np.interp(t - delay, t, q_ref) - q)


def _coarse_best(t: Array, y: Array, q_ref: Array, q: Array, use: Bool[Array, " N"], coarse: Float[Array, " d"]) -> int:
    """Index of the delay with the smallest squared residual. To save time, only some thousand rows are used."""
    rows = np.flatnonzero(use)
    rows = rows[:: max(len(rows) // _ROWS_OF_DELAY, 1)]
    errors = _errors(t, q_ref, q, coarse, rows)
    e, z = errors - errors.mean(axis=0), y[rows] - y[rows].mean()
    squared_residuals = z @ z - (z @ e) ** 2 / np.maximum(np.sum(e * e, axis=0), 1e-300)
    return int(np.argmin(squared_residuals))


def _errors(
    t: Array, q_ref: Array, q: Array, delays: Float[Array, " d"], rows: slice | Array = slice(None)
) -> Float[Array, "n d"]:
    """Position errors in some rows, one column per delay of the reference."""
    return np.column_stack([np.interp(t[rows] - delay, t, q_ref) - q[rows] for delay in delays])


def _neighbours(k: int, reach: int) -> slice:
    """Indices from ``k - reach`` to ``k + reach``."""
    return slice(max(k - reach, 0), k + reach + 1)


def _sums(errors: Float[Array, "N d"], y: Float[Array, " N"], use: Bool[Array, " N"]) -> Float[Array, "s d 6"]:
    """Sums over the used rows of each of ``s`` stretches, for each of ``d`` delays.

    The six sums are of 1, error, output, squared error, error times output, and squared output.
    """
    out = []
    for part in np.array_split(np.flatnonzero(use), _STRETCHES):
        e, z = errors[part], y[part, None]
        one = np.ones_like(e)
        out.append(np.stack([x.sum(axis=0) for x in (one, e, one * z, e * e, e * z, one * z * z)], axis=-1))
    return np.array(out)


def _best(sums: Float[Array, "d 6"], delays: Float[Array, " d"]) -> tuple[float, float, float]:
    """Gain, delay and residual rms at the delay with the smallest residual, interpolated by a parabola.

    Args:
        sums: Result of `_sums`, added over stretches.
        delays: The delays [s].
    """
    n, e, y, ee, ey, yy = sums.T
    # Products of centred values, because the controller may have an offset.
    centred_ee, centred_ey = ee - e * e / n, ey - e * y / n
    gain = centred_ey / np.maximum(centred_ee, 1e-300)
    variance = np.maximum(yy - y * y / n - gain * centred_ey, 0.0) / n
    k = int(np.argmin(variance))
    if 0 < k < len(delays) - 1:
        before, lowest, after = variance[k - 1 : k + 2]
        bend = before - 2 * lowest + after
        shift = 0.5 * (before - after) / bend if bend > 0 else 0.0
        delay = delays[k] + shift * (delays[1] - delays[0])
        return float(np.interp(delay, delays, gain)), float(delay), float(np.sqrt(variance[k]))
    return float(gain[k]), float(delays[k]), float(np.sqrt(variance[k]))


def _quantum(y: Float[Array, " n"]) -> float:
    """Step to which the recorder rounds an output: the smallest difference between two of its values."""
    steps = np.diff(np.unique(y))
    return float(steps.min()) if len(steps) else 0.0


def _dead_band(y: Float[Array, " n"], error: Float[Array, " n"]) -> float | None:
    """Half width [rad or m] of the dead band: the error up to which the output is zero; None without a dead band."""
    silent = y == 0
    if silent.mean() < _SILENT:
        return None
    width = float(np.quantile(np.abs(error[silent]), 0.95))
    inside = np.abs(error) < 0.8 * width
    return width if inside.any() and silent[inside].mean() > 0.8 else None


def _hold(t: Float[Array, " N"], q_ref: Float[Array, " N"], step: float) -> float | None:
    """Time [s] for which a moving reference keeps a value; None if it changes at every sample."""
    changes = np.flatnonzero(np.diff(q_ref))
    if len(changes) < _FEWEST // 4:
        return None
    spans = np.diff(t[changes])
    # Long spans without a change are rests of the reference. While it moves, spans are near the median.
    typical = float(np.median(spans))
    moving = spans < 5 * typical
    # Share of the samples of the moving reference that repeat the value before them.
    repeated = 1.0 - step * moving.sum() / max(float(spans[moving].sum()), 1e-300)
    return float(spans[moving].mean()) if repeated > _REPEATED else None
