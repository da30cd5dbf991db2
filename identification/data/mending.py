"""Repairs of a recording that need no guess: encoder turns are unwrapped, short spikes and dropouts cut out.

A position that jumps by a whole turn from one sample to the next has not moved: its encoder counts from zero again, in
radians, or in degrees where the unit is not known yet. A value that departs by far more than all changes near it and
returns after at most five samples is neither motion nor torque: it is replaced by linear interpolation. A torque is
kept where the velocity of some joint jumps with it, as both do when a reference steps. Warnings state the corrections
with counts and times.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identification.data.recording import Recording, when
from phantom_dyn.array_types import Array, Bool, Float, read_only

_TURN, _TURN_DEGREES = 2 * np.pi, 360.0  # [rad, degrees]
# A jump is a whole turn if its remainder is at most this [rad], and at most this many times the largest ordinary step
# among so many before and after it.
_REST, _STEPS, _AROUND = 0.5, 5.0, 20
# Largest number of samples of a spike or dropout: a longer one cannot be interpolated.
_LONGEST = 5
# Smallest size of a spike, as a multiple of the 99 % quantile of all changes from sample to sample.
_TIMES = 6.0
# A spike ends where at most the first share of the jump remains; until then at least the second share remains.
_BACK, _AWAY = 0.2, 0.5
# Smallest spike of a position [rad or m] and of a torque (in its standard deviations) that is cut out.
_LEAST_ANGLE, _LEAST_LENGTH, _LEAST_TORQUE = 0.02, 0.002, 0.5
# A velocity jumps where it changes by this multiple of the 95 % quantile of all changes, each from the mean of so many
# samples to that of the next ones.
_JUMPS, _MEAN_OF = 3.0, 10
# Share of bad samples above which they are no exceptions, so that nothing is cut out.
_MOST = 0.01


def mended(recording: Recording, prismatic: Array) -> Recording:
    """The recording with whole turns put together and short spikes cut out; its warnings say what was done.

    Args:
        recording: Raw samples.
        prismatic: True for linear joints, shape ``(nv,)``.
    """
    together = _turns_together(recording, prismatic)
    q, at_q = _without_spikes(together.q, np.where(prismatic, _LEAST_LENGTH, _LEAST_ANGLE))
    warnings = _spike_warnings(together, "q", at_q)
    tau = together.tau
    if tau is not None:
        tau = _without_lost(together, tau, at_q)
        least = _LEAST_TORQUE * np.array([column.std() for column in tau.T])
        tau, at_tau = _without_spikes(tau, least, _jumps_of_velocity(q))
        warnings += _spike_warnings(together, "the torque", at_tau)
    if not warnings:
        return together
    mended_tau = None if tau is None else read_only(tau)
    return replace(together, q=read_only(q), tau=mended_tau, warnings=(*together.warnings, *warnings))


def mended_position(q: Float[Array, " N"]) -> Float[Array, " N"]:
    """A measured position [rad] as `mended` leaves it: without whole turns, and without spikes and dropouts."""
    together = whole_turns(np.ascontiguousarray(q))[0]
    return _without_spikes(together[:, None], np.array([_LEAST_ANGLE]))[0][:, 0]


def _turns_together(recording: Recording, prismatic: Array) -> Recording:
    """Positions of joints that turn without the jumps of their encoders; references and second encoders go along."""
    q, others, warnings = recording.q, {}, []
    for j in np.flatnonzero(~np.asarray(prismatic, dtype=bool)):
        turn = _TURN
        together, at = whole_turns(np.ascontiguousarray(recording.q[:, j]))
        if not len(at):
            turn = _TURN_DEGREES
            together, at = whole_turns(np.ascontiguousarray(recording.q[:, j]), turn)
        if not len(at):
            continue
        if not warnings:
            q = q.copy()
            others = {name: x.copy() for name in ("q_ref", "x") if (x := getattr(recording, name)) is not None}
        q[:, j] = together
        for values in others.values():
            column = whole_turns(values[:, j], turn)[0]
            # A reference that does not jump with the encoder may differ from the position by whole turns.
            values[:, j] = column - turn * np.round(np.median(column - q[:, j]) / turn)
        times = "once" if len(at) == 1 else f"{len(at)} times"
        unit = "" if turn == _TURN else " of 360"
        warnings.append(
            f"{recording.file}: q of {recording.joint_names[j]} jumps by whole turns{unit} {times} "
            f"({when(recording.t[at])}): its turns were put together."
        )
    if not warnings:
        return recording
    return replace(
        recording,
        q=read_only(q),
        warnings=(*recording.warnings, *warnings),
        **{name: read_only(values) for name, values in others.items()},
    )


def whole_turns(q: Float[Array, " N"], turn: float = _TURN) -> tuple[Float[Array, " N"], Array]:
    """A position [rad] without its jumps by whole turns, and the samples before which they were.

    Args:
        q: Positions.
        turn: A whole turn in their unit.
    """
    steps = np.diff(q)
    turns = np.round(steps / turn)
    at = np.flatnonzero(turns)
    if not len(at):
        return q, at
    rest = np.abs(steps - turn * turns)
    real, most = [], _REST * turn / _TURN
    for k in at:
        around = np.abs(steps[max(k - _AROUND, 0) : k + _AROUND + 1])
        plain = around[around < turn / 2]
        usual = float(plain.max()) if len(plain) > len(around) / 2 else np.inf
        # Where positions are noisy throughout, a jump is not significant.
        real.append(rest[k] <= min(most, _STEPS * usual + 1e-3) and usual < most)
    at = at[np.array(real)]
    correction = np.zeros(len(q))
    correction[at + 1] = -turn * turns[at]
    return q + np.cumsum(correction), at + 1


def spikes(x: Float[Array, " N"], least: float) -> list[tuple[int, int]]:
    """First sample and end (exclusive) of each spike or dropout of at most five samples.

    Args:
        x: Samples.
        least: Smallest size of a spike, in the unit of ``x``.
    """
    steps = np.abs(np.diff(x))
    threshold = max(least, _TIMES * float(np.percentile(steps, 99)))
    out: list[tuple[int, int]] = []
    for k in np.flatnonzero(steps > threshold) + 1:
        if out and k < out[-1][1] + 1:
            continue
        jump = x[k] - x[k - 1]
        for end in range(k + 1, min(k + _LONGEST + 1, len(x))):
            away = (x[k:end] - x[k - 1]) / jump
            if abs(x[end] - x[k - 1]) <= _BACK * abs(jump) and away.min() >= _AWAY:
                out.append((int(k), end))
                break
    return out


def _jumps_of_velocity(q: Float[Array, "N nv"]) -> Bool[Array, " N"]:
    """True beside samples at which the velocity of some joint jumps."""
    out = np.zeros(len(q), dtype=bool)
    if len(q) <= 2 * _MEAN_OF:
        return out
    changes = np.abs(q[2 * _MEAN_OF :] - 2.0 * q[_MEAN_OF:-_MEAN_OF] + q[: -2 * _MEAN_OF])
    usual = np.percentile(changes, 95, axis=0)
    at = np.flatnonzero((changes > _JUMPS * np.maximum(usual, 1e-12)).any(axis=1)) + _MEAN_OF
    for k in range(-_LONGEST, _LONGEST + 1):
        out[np.clip(at + k, 0, len(q) - 1)] = True
    return out


def _without_spikes(
    x: Float[Array, "N nv"], least: Float[Array, " nv"], real: Bool[Array, " N"] | None = None
) -> tuple[Array, list[list[tuple[int, int]]]]:
    """Columns whose spikes are bridged by straight lines, and the spikes; a column with too many stays as it is.

    Args:
        x: Samples.
        least: Smallest size of a spike in each column.
        real: Samples that are kept in any case; None without any.
    """
    out, found = x, []
    for j in range(x.shape[1]):
        runs = spikes(np.ascontiguousarray(x[:, j]), float(least[j]))
        runs = runs if real is None else [run for run in runs if not real[run[0] : run[1]].any()]
        bad = np.zeros(len(x), dtype=bool)
        for start, end in runs:
            bad[start:end] = True
        if bad.mean() > _MOST:
            runs, bad = [], np.zeros(len(x), dtype=bool)
        if runs:
            kept = np.flatnonzero(~bad)
            out = x.copy() if out is x else out
            out[bad, j] = np.interp(np.flatnonzero(bad), kept, x[kept, j])
        found.append(runs)
    return out, found


def _without_lost(recording: Recording, tau: Float[Array, "N nv"], at_q: list[list[tuple[int, int]]]) -> Array:
    """Torques from voltages, bridged where the position was lost: the controller computed the voltage from it."""
    out = tau
    for j, (joint, runs) in enumerate(zip(recording.joint_names, at_q, strict=True)):
        if not runs or recording.torque_from.get(joint) != "u":
            continue
        kept = np.ones(len(tau), dtype=bool)
        for start, end in runs:
            kept[start:end] = False
        out = tau.copy() if out is tau else out
        out[~kept, j] = np.interp(np.flatnonzero(~kept), np.flatnonzero(kept), tau[kept, j])
    return out


def _spike_warnings(recording: Recording, what: str, found: list[list[tuple[int, int]]]) -> list[str]:
    out = []
    for joint, runs in zip(recording.joint_names, found, strict=True):
        if runs:
            samples = sum(end - start for start, end in runs)
            one = len(runs) == 1
            out.append(
                f"{recording.file}: {what} of {joint} has {len(runs)} {'spike' if one else 'spikes'} or "
                f"{'dropout' if one else 'dropouts'} of {samples} {'sample' if samples == 1 else 'samples'} in all "
                f"({when(recording.t[[start for start, _ in runs]])}): {'it was' if one else 'they were'} cut "
                "out."
            )
    return out
