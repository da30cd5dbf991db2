"""Repairs certain errors of a recording: unwraps turns of encoders, and replaces short spikes and dropouts.

If a position jumps by a whole turn from one sample to the next, the joint has not moved: its encoder has started to
count from zero again. The turn is in radians, or in degrees because a wrong unit is only found later. A value that
jumps by far more than other values change, and returns after at most five samples, is a wrong reading: it is replaced
by linear interpolation. A jump of the torque is kept if the velocity of some joint jumps at the same time, because both
jump when a reference steps. Warnings state the corrections with counts and times.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identification.data.recording import Recording, when
from phantom_dyn.array_types import Array, Bool, Float, read_only

_TURN, _TURN_DEGREES = 2 * np.pi, 360.0  # [rad, degrees]
# Ordinary steps are steps of less than half a turn, within `_NEIGHBOURS` samples before and after a jump. The jump is a
# whole turn if its difference from whole turns is at most `_LARGEST_REMAINDER` [rad], and at most `_LARGEST_STEPS`
# times the largest ordinary step.
_LARGEST_REMAINDER, _LARGEST_STEPS, _NEIGHBOURS = 0.5, 5.0, 20
# Largest number of samples of a spike or dropout: a longer one cannot be interpolated.
_LONGEST_SPIKE = 5
# Smallest size of a spike, as a multiple of the 99 % quantile of all changes from sample to sample.
_SPIKE_QUANTILES = 6.0
# Distances from the value before a spike, as shares of its first jump: the largest one at its end, and the smallest one
# within it.
_RETURNED, _STILL_AWAY = 0.2, 0.5
# Smallest spike that is removed: of an angle [rad], of a length [m], and of a torque (in standard deviations of the
# joint's torque).
_SMALLEST_ANGLE, _SMALLEST_LENGTH, _SMALLEST_TORQUE = 0.02, 0.002, 0.5
# The mean velocities over `_MEAN_SAMPLES` samples before and after each sample are compared. The velocity jumps where
# they differ by more than `_VELOCITY_JUMP` times the 95 % quantile of these differences.
_VELOCITY_JUMP, _MEAN_SAMPLES = 3.0, 10
# If a larger share of the samples is in spikes, nothing is removed, because the spikes are no exceptions.
_LARGEST_BAD_SHARE = 0.01


def mended(recording: Recording, prismatic: Array) -> Recording:
    """The recording with whole turns unwrapped and short spikes removed; its warnings say what was done.

    Args:
        recording: Raw samples.
        prismatic: True for linear joints, shape ``(nv,)``.
    """
    unwrapped = _unwrapped(recording, prismatic)
    q, q_spikes = _without_spikes(unwrapped.q, np.where(prismatic, _SMALLEST_LENGTH, _SMALLEST_ANGLE))
    warnings = _spike_warnings(unwrapped, "q", q_spikes)
    tau = unwrapped.tau
    if tau is not None:
        tau = _without_torques_in_spikes(unwrapped, tau, q_spikes)
        least = _SMALLEST_TORQUE * np.array([column.std() for column in tau.T])
        tau, tau_spikes = _without_spikes(tau, least, _jumps_of_velocity(q))
        warnings += _spike_warnings(unwrapped, "the torque", tau_spikes)
    if not warnings:
        return unwrapped
    mended_tau = None if tau is None else read_only(tau)
    return replace(unwrapped, q=read_only(q), tau=mended_tau, warnings=(*unwrapped.warnings, *warnings))


def mended_position(q: Float[Array, " N"]) -> Float[Array, " N"]:
    """The measured position [rad] of one joint, repaired as in `mended`: without whole turns, spikes and dropouts."""
    unwrapped = whole_turns(np.ascontiguousarray(q))[0]
    return _without_spikes(unwrapped[:, None], np.array([_SMALLEST_ANGLE]))[0][:, 0]


def _unwrapped(recording: Recording, prismatic: Array) -> Recording:
    """The recording without jumps by whole turns, in positions, references and positions of second encoders."""
    q, others, warnings = recording.q, {}, []
    for j in np.flatnonzero(~np.asarray(prismatic, dtype=bool)):
        turn = _TURN
        unwrapped, jumps = whole_turns(np.ascontiguousarray(recording.q[:, j]))
        if not len(jumps):
            turn = _TURN_DEGREES
            unwrapped, jumps = whole_turns(np.ascontiguousarray(recording.q[:, j]), turn)
        if not len(jumps):
            continue
        if not warnings:
            q = q.copy()
            others = {name: x.copy() for name in ("q_ref", "x") if (x := getattr(recording, name)) is not None}
        q[:, j] = unwrapped
        for values in others.values():
            column = whole_turns(values[:, j], turn)[0]
            # A reference that does not jump with the encoder may differ from the position by whole turns.
            values[:, j] = column - turn * np.round(np.median(column - q[:, j]) / turn)
        times = "once" if len(jumps) == 1 else f"{len(jumps)} times"
        unit = "" if turn == _TURN else " of 360"
        warnings.append(
            f"{recording.file}: q of {recording.joint_names[j]} jumps by whole turns{unit} {times} "
            f"({when(recording.t[jumps])}): its turns were put together."
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
    """Positions of one joint without jumps by whole turns, and the index of the first sample after each jump.

    Args:
        q: Positions [rad, or another unit of ``turn``].
        turn: A whole turn in the unit of ``q``.
    """
    steps = np.diff(q)
    turns = np.round(steps / turn)
    jumps = np.flatnonzero(turns)
    if not len(jumps):
        return q, jumps
    remainders = np.abs(steps - turn * turns)
    is_turn, largest_remainder = [], _LARGEST_REMAINDER * turn / _TURN
    for k in jumps:
        neighbours = np.abs(steps[max(k - _NEIGHBOURS, 0) : k + _NEIGHBOURS + 1])
        ordinary = neighbours[neighbours < turn / 2]
        ordinary_step = float(ordinary.max()) if len(ordinary) > len(neighbours) / 2 else np.inf
        # If neighbouring steps are large as well, the positions are noisy, and a jump does not show a turn.
        is_turn.append(
            remainders[k] <= min(largest_remainder, _LARGEST_STEPS * ordinary_step + 1e-3)
            and ordinary_step < largest_remainder
        )
    jumps = jumps[np.array(is_turn)]
    correction = np.zeros(len(q))
    correction[jumps + 1] = -turn * turns[jumps]
    return q + np.cumsum(correction), jumps + 1


def spikes(x: Float[Array, " N"], least: float) -> list[tuple[int, int]]:
    """First sample and end (exclusive) of each spike or dropout of at most five samples.

    Args:
        x: Samples.
        least: Smallest size of a spike, in the unit of ``x``.
    """
    steps = np.abs(np.diff(x))
    threshold = max(least, _SPIKE_QUANTILES * float(np.percentile(steps, 99)))
    out: list[tuple[int, int]] = []
    for k in np.flatnonzero(steps > threshold) + 1:
        # Steps within the last spike, and the step at its end, belong to that spike.
        if out and k < out[-1][1] + 1:
            continue
        jump = x[k] - x[k - 1]
        for end in range(k + 1, min(k + _LONGEST_SPIKE + 1, len(x))):
            away = (x[k:end] - x[k - 1]) / jump
            if abs(x[end] - x[k - 1]) <= _RETURNED * abs(jump) and away.min() >= _STILL_AWAY:
                out.append((int(k), end))
                break
    return out


def _jumps_of_velocity(q: Float[Array, "N nv"]) -> Bool[Array, " N"]:
    """True within five samples of a sample at which the velocity of some joint jumps."""
    out = np.zeros(len(q), dtype=bool)
    if len(q) <= 2 * _MEAN_SAMPLES:
        return out
    # The mean velocity after a sample minus that before the sample, times `_MEAN_SAMPLES` sample times.
    changes = np.abs(q[2 * _MEAN_SAMPLES :] - 2.0 * q[_MEAN_SAMPLES:-_MEAN_SAMPLES] + q[: -2 * _MEAN_SAMPLES])
    usual = np.percentile(changes, 95, axis=0)
    jumps = np.flatnonzero((changes > _VELOCITY_JUMP * np.maximum(usual, 1e-12)).any(axis=1)) + _MEAN_SAMPLES
    for k in range(-_LONGEST_SPIKE, _LONGEST_SPIKE + 1):
        out[np.clip(jumps + k, 0, len(q) - 1)] = True
    return out


def _without_spikes(
    x: Float[Array, "N nv"], least: Float[Array, " nv"], keep: Bool[Array, " N"] | None = None
) -> tuple[Array, list[list[tuple[int, int]]]]:
    """Columns with spikes replaced by straight lines, and the spikes; a column with too many spikes is not changed.

    Args:
        x: Samples.
        least: Smallest size of a spike in each column.
        keep: True for samples that are never replaced; None if there are none.
    """
    out, spikes_by_column = x, []
    for j in range(x.shape[1]):
        runs = spikes(np.ascontiguousarray(x[:, j]), float(least[j]))
        runs = runs if keep is None else [run for run in runs if not keep[run[0] : run[1]].any()]
        bad = np.zeros(len(x), dtype=bool)
        for start, end in runs:
            bad[start:end] = True
        if bad.mean() > _LARGEST_BAD_SHARE:
            runs, bad = [], np.zeros(len(x), dtype=bool)
        if runs:
            kept = np.flatnonzero(~bad)
            out = x.copy() if out is x else out
            out[bad, j] = np.interp(np.flatnonzero(bad), kept, x[kept, j])
        spikes_by_column.append(runs)
    return out, spikes_by_column


def _without_torques_in_spikes(
    recording: Recording, tau: Float[Array, "N nv"], q_spikes: list[list[tuple[int, int]]]
) -> Array:
    """Torques, of which those from voltages are interpolated over spikes of the position.

    The controller reacted to the wrong position with a wrong voltage.
    """
    out = tau
    for j, (joint, runs) in enumerate(zip(recording.joint_names, q_spikes, strict=True)):
        if not runs or recording.torque_from.get(joint) != "u":
            continue
        kept = np.ones(len(tau), dtype=bool)
        for start, end in runs:
            kept[start:end] = False
        out = tau.copy() if out is tau else out
        out[~kept, j] = np.interp(np.flatnonzero(~kept), np.flatnonzero(kept), tau[kept, j])
    return out


def _spike_warnings(recording: Recording, what: str, found: list[list[tuple[int, int]]]) -> list[str]:
    """One warning for each joint with spikes, with their number and times."""
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
