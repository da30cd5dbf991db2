"""Checks of sampling times and torques: jitter, gaps, clipped, constant and zero torques."""

from __future__ import annotations

import numpy as np

from identification.data.checks.smoothed_copy import included
from identification.data.recording import Recording, time_text
from phantom_dyn.array_types import Array, Float

# A time step is irregular if it differs from the median by more than this share; real-time systems keep 1 %.
_JITTER = 0.1
# Smallest share of irregular steps for a warning.
_IRREGULAR_SHARE = 0.01
# A time step of more than this number of medians is a gap: samples are missing.
_GAP = 2.5

# A torque is clipped if at least this share of its samples, or this number of samples in a row, have the extreme value.
# If every value of the torque is held for some rows, these rows count as one sample.
_CLIPPED_SHARE, _CLIPPED_RUN = 0.01, 5
# A torque is flat if it keeps one value without a break for at least this share of the rows.
_MOSTLY = 0.5
# A value that the torque repeats while the joint moves is no measurement if it fills at least the first share of the
# rows, is at least the second number times as frequent as any other value, and the torque jumps to and from it by more
# than the third number times its usual step. At a limit or at rest a torque repeats a value without such jumps.
_REPEATED, _TIMES_OTHERS, _JUMPS = 0.05, 10, 5.0
# The torque has to go to the repeated value at least the first number of times. If it goes there fewer than the second
# number of times, pulses or a drive that was switched off may be the cause. Then the value counts only if the other
# torques differ in size and none of them is near the value (`_GAP_BELOW`, `_ALIKE`).
_FEW, _OFTEN = 4, 20
# A joint moves at a sample if its travel from the first time [s] before it to the first time after it is more than the
# second share of the root mean square of this travel.
_MOVES_WITHIN, _AT_REST = 0.05, 0.1
# A joint that goes this often from one end of its range to the other needs a torque that changes.
_PASSAGES = 4
# Smallest over largest distance of the other torques from the repeated value. Above the first number, small torques are
# missing; above the second number, all torques have the same size.
_GAP_BELOW, _ALIKE = 0.1, 0.9
# Fewer samples in a row at the extreme value may be the peak of a repeated motion without noise.
_SHORTEST_RUN = 2
# A clipped torque has at least this number of samples at its extreme value for each sample at the next level. A smooth
# peak has at most 2.4, however coarsely it is rounded.
_TOP_HEAVY = 4


def check_timing(recording: Recording) -> tuple[str, ...]:
    """Warnings on irregular sampling and missing samples."""
    kept = included(recording)
    steps = np.diff(recording.t)[kept[1:] & kept[:-1]]
    starts = recording.t[:-1][kept[1:] & kept[:-1]]
    if not len(steps):
        return ()
    step = float(np.median(steps))
    gap = steps > _GAP * step
    out = []
    irregular = np.abs(steps - step) > _JITTER * step
    share = float(np.mean(irregular & ~gap))
    if share > _IRREGULAR_SHARE:
        low, high = np.percentile(steps[~gap], [1, 99])
        out.append(
            f"{recording.file}: sampling is irregular: {100 * share:.0f} % of the steps differ from the median of "
            f"{1e3 * step:.3g} ms by more than {100 * _JITTER:.0f} % (1st to 99th percentile {1e3 * low:.3g} to "
            f"{1e3 * high:.3g} ms)."
        )
    if gap.any():
        worst = int(np.argmax(steps))
        noun = "gap" if gap.sum() == 1 else "gaps"
        out.append(
            f"{recording.file}: {int(gap.sum())} {noun} in time; the longest lasts {steps[worst]:.3g} s at "
            f"t = {time_text(starts[worst])} s, where a step is {step:.3g} s."
        )
    return tuple(out)


def _clipped(tau: Float[Array, " N"]) -> tuple[float, float, int] | None:
    """Largest value, share of samples at it and longest run of them, if ``tau`` is clipped there; else None."""
    extent = np.ptp(tau)
    top = float(np.max(tau))
    levels = np.unique(tau)
    # A torque with few levels may have its next level far below the top. Otherwise the next level is looked for near
    # the top; pulses, with hardly any levels, have none there.
    if not _FEW <= len(levels) < 50:
        levels = levels[levels >= top - 0.1 * extent]
    # Levels that differ by rounding only are one level.
    levels = levels[np.concatenate([[True], np.diff(levels) > 1e-9 * extent])]
    step = max(float(top - levels[-2]) if len(levels) > 1 and len(levels) < 50 else 0.0, 2e-3 * extent)
    at_top = tau >= top - 1e-9 * max(extent, abs(top))
    below = (tau < top) & ~at_top & (tau >= top - 1.5 * step)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], at_top, [False]])))
    run = int(np.max(edges[1::2] - edges[::2]))
    share = float(np.mean(at_top))
    samples = run / _rows_held(tau)
    often = share >= _CLIPPED_SHARE and samples >= _SHORTEST_RUN
    if (often or samples >= _CLIPPED_RUN) and at_top.sum() >= _TOP_HEAVY * max(int(below.sum()), 1):
        return top, share, run
    return None


def _rows_held(tau: Float[Array, " N"]) -> float:
    """Median number of rows for which a torque is held: more than 1 if it is read at a lower rate than it is logged."""
    edges = np.flatnonzero(np.diff(tau, prepend=np.nan, append=np.nan) != 0)
    values = tau[edges[:-1]]
    between = (values > np.min(tau)) & (values < np.max(tau))
    return float(np.median(np.diff(edges)[between])) if between.any() else 1.0


def check_repeated(recording: Recording) -> dict[str, str]:
    """Warnings, by joint, on torques with one value in many scattered rows: a dead band of the drive, or lost readings.

    Such a column is no measured torque, so that a diagnosis does not judge its joint.
    """
    if recording.tau is None:
        return {}
    out, kept = dict[str, str](), included(recording)
    for j, joint in enumerate(recording.joint_names):
        tau = recording.tau[kept, j]
        found = _repeated(recording.t[kept], recording.q[kept, j], tau)
        if found is None:
            continue
        value, starts, jump = found
        least = float(np.abs(tau[tau != value] - value).min())
        stated = (
            f"{recording.file}: tau.{joint} is exactly {value:.6g} in {100 * np.mean(tau == value):.0f} % of the rows, "
            f"{starts} times for a while"
        )
        if least >= _GAP_BELOW * np.abs(tau - value).max():
            closer = "never smaller than" if value == 0 else "never closer to it than"
            out[joint] = (
                f"{stated}, and {closer} {least:.2g} otherwise: its drive reports small torques as none. A diagnosis "
                f"does not judge {joint}: log the torque before it is cut off."
            )
        else:
            out[joint] = (
                f"{stated}, while {joint} moves, and jumps there and back by {jump:.2g}: these rows are no readings of "
                f"its torque. A diagnosis does not judge {joint}: log a torque that was read for every row."
            )
    return out


def _repeated(t: Float[Array, " N"], q: Float[Array, " N"], tau: Float[Array, " N"]) -> tuple[float, int, float] | None:
    """A value that no measured torque would repeat so often, how often it begins, and the median jump; else None.

    A measured torque also repeats values, in three cases that are excluded. A coarse torque repeats other values, too,
    and differs by one step from row to row. A joint at rest has a constant torque. A torque at a limit reaches this
    limit without a jump.

    Args:
        t: Time [s].
        q: Position of the joint [rad or m].
        tau: Torque of the joint [N m or N].
    """
    if len(tau) < 2 * _OFTEN:
        return None
    rows = max(1, round(_MOVES_WITHIN / float(np.median(np.diff(t)))))
    travel = np.abs(np.roll(q, -rows) - np.roll(q, rows))
    moving = travel > _AT_REST * np.sqrt(np.mean(travel**2))
    values, counts = np.unique(tau[moving], return_counts=True)
    if len(values) < 3:
        return None
    second_most, most = np.sort(counts)[-2:]
    value = float(values[np.argmax(counts)])
    repeated = tau == value
    starts = int(np.count_nonzero(np.diff(repeated.astype(int)) == 1))
    if most < max(_REPEATED * len(tau), _TIMES_OTHERS * second_most) or starts < _FEW:
        return None
    others = np.abs(tau[~repeated] - value)
    if starts < _OFTEN and not _GAP_BELOW * others.max() < others.min() < _ALIKE * others.max():
        return None
    steps = np.abs(np.diff(tau))
    elsewhere = steps[~repeated[1:] & ~repeated[:-1] & (steps > 0)]
    jump = float(np.median(steps[repeated[1:] != repeated[:-1]]))
    usual = float(np.median(elsewhere)) if len(elsewhere) else 0.0
    return (value, starts, jump) if jump > _JUMPS * usual else None


def check_flat(recording: Recording) -> tuple[str, ...]:
    """Warnings on torques that stay constant for a long time while their joint moves to and fro."""
    if recording.tau is None:
        return ()
    out, kept = [], included(recording)
    for j, joint in enumerate(recording.joint_names):
        tau, q = recording.tau[kept, j], recording.q[kept, j]
        if not len(tau) or np.ptp(tau) == 0:
            continue
        edges = np.flatnonzero(np.diff(tau, prepend=np.nan, append=np.nan) != 0)
        longest = int(np.argmax(np.diff(edges)))
        start, stop = int(edges[longest]), int(edges[longest + 1])
        if stop - start < _MOSTLY * len(tau) or _passages(q[start:stop], float(np.ptp(q))) < _PASSAGES:
            continue
        first, last = (time_text(float(recording.t[kept][k])) for k in (start, stop - 1))
        out.append(
            f"{recording.file}: tau.{joint} is {tau[start]:.6g} in every row from {first} to {last} s "
            f"({100 * (stop - start) / len(tau):.0f} % of the rows), while {joint} goes to and fro: if its drive was "
            f"held or off there, nothing is to be done; if its torque was not recorded, leave that out with "
            f"--exclude {first}:{last}."
        )
    return tuple(out)


def _passages(q: Float[Array, " n"], travel: float) -> int:
    """Number of times that a joint goes from the lower to the upper third of its range, or back.

    Args:
        q: Positions, a part of those of the recording.
        travel: Range of the joint's positions in the whole recording.
    """
    thirds = np.digitize(q, q.min() + travel * np.array([1 / 3, 2 / 3]))
    ends = thirds[thirds != 1]
    return int(np.count_nonzero(np.diff(ends)))


def check_clipping(recording: Recording) -> tuple[str, ...]:
    """Warnings on torques that stay at their extreme value, as a clipped signal does."""
    if recording.tau is None:
        return ()
    out = []
    for j, joint in enumerate(recording.joint_names):
        tau = recording.tau[:, j]
        if np.ptp(tau) == 0:
            if tau[0] != 0:
                out.append(f"{recording.file}: the torque of {joint} is {tau[0]:.6g} throughout: was it recorded?")
            continue
        for sign in (1.0, -1.0):
            found = _clipped(sign * tau)
            if found is not None:
                value, share, run = found
                repeated = _repeated(recording.t, recording.q[:, j], tau)
                if repeated is not None and sign * value == repeated[0]:
                    continue  # a torque reaches a limit without a jump
                out.append(
                    f"{recording.file}: the torque of {joint} sits at {sign * value:.6g} for {100 * share:.2g} % of "
                    f"the samples, up to {run} in a row: it is clipped there."
                )
    return tuple(out)
