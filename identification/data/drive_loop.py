"""The position loop of a drive, read from its log before any dynamics: regression of its output on the position error.

A drive with its own position controller has the output ``y = gain (q_ref(t - delay) - q) + offset``, clipped. Where
this output is logged (voltage, share of the supply, current or torque), gain, limit, dead band, delay and hold of the
reference are estimated without a model of the robot. Rows at the limit are censored: they only show that the loop
commands at least that much. An output that follows the loop up to rounding was computed and not measured, so that it
does not show the delay of the drive.
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
# Rows within this share of the largest output are at the limit (a supply varies by a per cent), if they are more than
# this share of all rows.
_NEAR, _SHARE_AT_LIMIT = 0.015, 0.01
# Residual, as a share of the output's rms, up to which an output without delay was computed and not measured: it has
# rounding and variations of the supply only. Measured drives have 5 to 10 %.
_ROUNDING = 0.015
# Rows farther from the loop than so many robust deviations are bad readings; at most this share of all.
_FAR, _MOST_BAD = 6.0, 0.02
# Share of the rows without output from which on there may be a dead band.
_SILENT = 0.02
# Share of repeated samples of a moving reference from which on it is held for longer than a sample.
_REPEATED = 0.3
# A drive that protects itself beyond an error has less output than this share of the loop's command, in more than this
# share of the rows; and a fit with two levels has less than this share of the squared residual of one gain.
_DROPPED, _SHARE_DROPPED, _OF_ONE_GAIN = 0.7, 0.01, 0.3
# Number of rows that are enough for a first estimate of the delay.
_ROWS_OF_DELAY = 4000
# Number of rows that are enough to find a drop of the output; and ratio to the usual step of a position from which on a
# row that differs from both neighbours is a bad reading.
_ROWS_OF_DROP, _JUMP = 4000, 10.0
# Half width, in standard deviations, of the interval of an estimated delay.
_DEVIATIONS = 3.0


@dataclass(frozen=True)
class DriveLoop:
    """Parameters of one drive's control loop by regression; standard deviations by a jackknife over stretches of time.

    Attributes:
        output: Quantity that was logged: ``u``, ``duty``, ``i`` or ``tau``.
        gain: Output per position error [V/rad, 1/rad, A/rad or N m/rad; per m of a linear joint].
        gain_std: Its deviation.
        delay: Time [s] by which the reference arrives later than it is recorded.
        delay_std: Its deviation.
        limit: Largest output, at which it is clipped; None where it never is.
        at_limit: Share of the rows that are clipped.
        dead_band: Position error [rad or m] below which there is no output; None where none is seen.
        hold: Time [s] for which one reference acts, longer than a sample; None where every sample has its own.
        rest: Rms of the output's residual, in rows that are not clipped.
        computed: True if the output is the loop itself up to rounding, so that it was computed and not measured.
        drops_beyond: Position error [rad or m] beyond which the drive protects itself; infinite where it never does.
        drops_to: Its output beyond that error.
        dropped: Share of the rows beyond that error.
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
    rest: float
    computed: bool
    drops_beyond: float = np.inf
    drops_to: float = np.inf
    dropped: float = 0.0

    def put_out(self, error: Float[Array, " N"]) -> Float[Array, " N"]:
        """Output at position errors [rad or m], clipped and dropped, without an offset."""
        limit = np.inf if self.limit is None else self.limit
        most = np.where(np.abs(error) > self.drops_beyond, min(self.drops_to, limit), limit)
        return np.clip(self.gain * error, -most, most)


def drive_loop(
    output: str, t: Float[Array, " N"], y: Float[Array, " N"], q_ref: Float[Array, " N"], q: Float[Array, " N"]
) -> DriveLoop | None:
    """The loop of one drive; None where its output does not follow the position error.

    Args:
        output: Name of the quantity.
        t: Times [s].
        y: Output of the drive.
        q_ref: References as recorded [rad or m].
        q: Measured positions.
    """
    finite = np.isfinite(y) & np.isfinite(q_ref) & np.isfinite(q)
    if finite.sum() < _FEWEST or not np.ptp(y[finite]) > 0 or not np.ptp(q_ref[finite]) > 0:
        return None
    limit, clipped = _clipping(y, finite)
    step = float(np.median(np.diff(t)))
    delays = np.arange(0.0, _LONGEST, step / _PER_STEP)
    drop = _drop(t, y, q_ref, q, finite & ~clipped & ~_lone(q), delays[::_PER_STEP])
    dropped = np.zeros(len(y), dtype=bool) if drop is None else _beyond(t, q_ref, q, *drop)
    use = _without_bad(t, y, q_ref, q, finite & ~clipped & ~dropped, delays, np.inf if limit is None else limit)
    if limit is not None and not _commands_more(t, y, q_ref, q, use, clipped, delays):
        limit, clipped = None, np.zeros(len(y), dtype=bool)
        use = _without_bad(t, y, q_ref, q, finite & ~dropped, delays, np.inf)
    if use.sum() < _FEWEST:
        return None
    delays = delays[_about(_PER_STEP * _coarse_best(t, y, q_ref, q, use, delays[::_PER_STEP]), 2 * _PER_STEP)]
    errors = _errors(t, q_ref, q, delays)
    sums = _sums(errors, y, use)
    gain, delay, rest = _best(sums.sum(axis=0), delays)
    if gain <= 0 or rest > np.sqrt(1.0 - _EXPLAINED) * float(np.std(y[use])):
        return None
    left_out = np.array([_best(sums.sum(axis=0) - part, delays)[:2] for part in sums])
    std = np.sqrt((_STRETCHES - 1) * np.var(left_out, axis=0))
    # Two neighbours are as near as the grid says.
    std[1] = max(std[1], step / _PER_STEP / np.sqrt(12))
    size = float(np.sqrt(np.mean(y[use] ** 2)))
    computed = delay < step / _PER_STEP and rest <= max(_ROUNDING * size, _quantum(y[use]))
    return DriveLoop(
        output,
        gain,
        float(std[0]),
        0.0 if computed else delay,
        float(std[1]),
        limit,
        float(clipped.sum() / finite.sum()),
        _dead_band(y[use], errors[use, int(np.argmin(np.abs(delays - delay)))]),
        _hold(t, q_ref, step),
        rest,
        computed,
        *((np.inf, np.inf) if drop is None else (drop[1], float(np.median(np.abs(y[finite & dropped]))))),
        float((finite & dropped).sum() / finite.sum()),
    )


def _lone(q: Float[Array, " N"]) -> Bool[Array, " N"]:
    """Rows whose position is far from both its neighbours: bad readings."""
    away = np.minimum(np.abs(np.diff(q, prepend=q[:1])), np.abs(np.diff(q, append=q[-1:])))
    return away > _JUMP * max(float(np.median(np.abs(np.diff(q)))), 1e-12)


def _drop(
    t: Array, y: Array, q_ref: Array, q: Array, use: Bool[Array, " N"], delays: Float[Array, " d"]
) -> tuple[float, float] | None:
    """Delay [s] and position error [rad or m] from which on a drive puts out little; None if it never does.

    For one sign of the error, the output is a line through the origin up to that error and a constant beyond. Every
    error in the data is tried: sorted by error, cumulative sums give the squared residuals of both parts.
    """
    rows = np.flatnonzero(use)
    rows = rows[:: max(len(rows) // _ROWS_OF_DROP, 1)]
    least, best = np.inf, None
    for delay in delays:
        error = np.interp(t[rows] - delay, t, q_ref) - q[rows]
        order = np.argsort(np.abs(error))
        e, z = np.abs(error)[order], (y[rows] * np.sign(error))[order]
        ee, ez, zz, zs = (np.cumsum(x) for x in (e * e, e * z, z * z, z))
        ahead = np.arange(len(e) - 1, 0, -1)
        gain, level = ez[:-1] / np.maximum(ee[:-1], 1e-300), (zs[-1] - zs[:-1]) / ahead
        left = zz[-1] - gain * ez[:-1] - level * (zs[-1] - zs[:-1])
        there = (level < _DROPPED * gain * e[:-1]) & (ahead > _SHARE_DROPPED * len(e))
        left = np.where(there, left, np.inf)
        k = int(np.argmin(left))
        if left[k] < min(least, _OF_ONE_GAIN * (zz[-1] - ez[-1] ** 2 / max(ee[-1], 1e-300))):
            least, best = float(left[k]), (float(delay), float(0.5 * (e[k] + e[k + 1])))
    if best is None:
        return None
    # A drop lasts; single rows are bad readings.
    there = use & _beyond(t, q_ref, q, *best)
    return best if 2 * int(np.sum(there[1:] & there[:-1])) > there.sum() else None


def _beyond(t: Array, q_ref: Array, q: Array, delay: float, error: float) -> Bool[Array, " N"]:
    """Rows whose position error is beyond one, with a reference that is late."""
    return np.abs(np.interp(t - delay, t, q_ref) - q) > error


def read_delays(
    loops: tuple[DriveLoop | None, ...], nv: int, frame: float = 0.0
) -> tuple[Float[Array, " nv"], Float[Array, " nv"]]:
    """Least and largest delay of each joint's reference [s] that its loop allows; zero and infinite if none was read.

    A computed output does not show the delay of the drive.

    Args:
        loops: Loop of each joint; may be empty.
        nv: Number of joints.
        frame: Time [s] for which a reference is held: it arrived up to this time before the reading.
    """
    least, most = np.zeros(nv), np.full(nv, np.inf)
    for j, loop in enumerate(loops):
        if loop is not None and not loop.computed:
            width = _DEVIATIONS * loop.delay_std
            least[j], most[j] = max(loop.delay - width - frame, 0.0), loop.delay + width
    return least, most


def _clipping(y: Float[Array, " N"], finite: Bool[Array, " N"]) -> tuple[float | None, Bool[Array, " N"]]:
    """Limit of the output and the rows at the limit; None and no rows if the largest values are only a few peaks."""
    largest = float(np.abs(y[finite]).max())
    there = finite & (np.abs(y) >= (1.0 - _NEAR) * largest)
    runs = int(np.sum(there[1:] & there[:-1]))
    if there.sum() < _SHARE_AT_LIMIT * finite.sum() or runs < 0.5 * there.sum():
        return None, np.zeros(len(y), dtype=bool)
    return float(np.median(np.abs(y[there]))), there


def _commands_more(
    t: Array, y: Array, q_ref: Array, q: Array, use: Bool[Array, " N"], clipped: Bool[Array, " N"], delays: Array
) -> bool:
    """True if the loop commands more than the largest outputs; at a peak of an output without a limit it does not."""
    if use.sum() < _FEWEST:
        return True
    commanded = _commanded(t, y, q_ref, q, use, delays)
    return bool(np.median(commanded[clipped] / y[clipped]) > 1.0 + _NEAR)


def _without_bad(
    t: Array, y: Array, q_ref: Array, q: Array, use: Bool[Array, " N"], delays: Float[Array, " d"], limit: float
) -> Bool[Array, " N"]:
    """Rows without those at which the loop commands the limit, and without single readings far from the command."""
    for _ in range(3):
        commanded = _commanded(t, y, q_ref, q, use, delays)
        within = use & (np.abs(commanded) < (1.0 - 2 * _NEAR) * limit)
        use = within if within.sum() >= _FEWEST else use
        away = np.abs(y - commanded - np.median((y - commanded)[use]))
        bad = use & (away > _FAR * 1.4826 * max(float(np.median(away[use])), 1e-12))
        if bad.sum() <= _MOST_BAD * use.sum():
            use = use & ~bad
    return use


def _commanded(
    t: Array, y: Array, q_ref: Array, q: Array, use: Bool[Array, " N"], delays: Float[Array, " d"]
) -> Float[Array, " N"]:
    """Output that a loop asks for with the gain that fits best, and with the best delay of whole samples."""
    coarse = delays[::_PER_STEP]
    coarse = coarse[_about(_coarse_best(t, y, q_ref, q, use, coarse), 1)]
    errors = _errors(t, q_ref, q, coarse)
    gain, delay, _ = _best(_sums(errors, y, use).sum(axis=0), coarse)
    return gain * (np.interp(t - delay, t, q_ref) - q)


def _coarse_best(t: Array, y: Array, q_ref: Array, q: Array, use: Bool[Array, " N"], coarse: Float[Array, " d"]) -> int:
    """Index of the delay that leaves least of some thousand rows: near it all rows are looked at."""
    rows = np.flatnonzero(use)
    rows = rows[:: max(len(rows) // _ROWS_OF_DELAY, 1)]
    errors = _errors(t, q_ref, q, coarse, rows)
    e, z = errors - errors.mean(axis=0), y[rows] - y[rows].mean()
    left = z @ z - (z @ e) ** 2 / np.maximum(np.sum(e * e, axis=0), 1e-300)
    return int(np.argmin(left))


def _errors(
    t: Array, q_ref: Array, q: Array, delays: Float[Array, " d"], rows: slice | Array = slice(None)
) -> Float[Array, "n d"]:
    """References less positions at some rows, if the references arrive late, by one delay a column."""
    return np.column_stack([np.interp(t[rows] - delay, t, q_ref) - q[rows] for delay in delays])


def _about(k: int, reach: int) -> slice:
    """Indices about one."""
    return slice(max(k - reach, 0), k + reach + 1)


def _sums(errors: Float[Array, "N d"], y: Float[Array, " N"], use: Bool[Array, " N"]) -> Float[Array, "s d 6"]:
    """Sums of products of error, output and one over the used rows of each stretch, for each delay."""
    out = []
    for part in np.array_split(np.flatnonzero(use), _STRETCHES):
        e, z = errors[part], y[part, None]
        one = np.ones_like(e)
        out.append(np.stack([x.sum(axis=0) for x in (one, e, one * z, e * e, e * z, one * z * z)], axis=-1))
    return np.array(out)


def _best(sums: Float[Array, "d 6"], delays: Float[Array, " d"]) -> tuple[float, float, float]:
    """Gain, delay and rms of the rest of the delay that leaves least, between neighbours by a parabola."""
    n, e, y, ee, ey, yy = sums.T
    var, cov = ee - e * e / n, ey - e * y / n
    gain = cov / np.maximum(var, 1e-300)
    rest = np.maximum(yy - y * y / n - gain * cov, 0.0) / n
    k = int(np.argmin(rest))
    if 0 < k < len(delays) - 1:
        before, here, after = rest[k - 1 : k + 2]
        bend = before - 2 * here + after
        shift = 0.5 * (before - after) / bend if bend > 0 else 0.0
        delay = delays[k] + shift * (delays[1] - delays[0])
        return float(np.interp(delay, delays, gain)), float(delay), float(np.sqrt(rest[k]))
    return float(gain[k]), float(delays[k]), float(np.sqrt(rest[k]))


def _quantum(y: Float[Array, " n"]) -> float:
    """Least difference of two different values of an output: what rounding may leave of a computed one."""
    steps = np.diff(np.unique(y))
    return float(steps.min()) if len(steps) else 0.0


def _dead_band(y: Float[Array, " n"], error: Float[Array, " n"]) -> float | None:
    """Error [rad or m] up to which an output of nothing is seen, if a loop without a dead band would put out some."""
    silent = y == 0
    if silent.mean() < _SILENT:
        return None
    width = float(np.quantile(np.abs(error[silent]), 0.95))
    inside = np.abs(error) < 0.8 * width
    return width if inside.any() and silent[inside].mean() > 0.8 else None


def _hold(t: Float[Array, " N"], q_ref: Float[Array, " N"], step: float) -> float | None:
    """Time [s] between changes of a reference that is repeated while it moves; None where it has one a sample."""
    changes = np.flatnonzero(np.diff(q_ref))
    if len(changes) < _FEWEST // 4:
        return None
    spans = np.diff(t[changes])
    # While the reference rests it does not change for long: the median is that of its motion.
    usual = float(np.median(spans))
    moving = spans < 5 * usual
    repeated = 1.0 - step * moving.sum() / max(float(spans[moving].sum()), 1e-300)
    return float(spans[moving].mean()) if repeated > _REPEATED else None
