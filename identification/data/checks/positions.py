"""Checks of positions and velocities: repeated samples, jumps, coarse encoders, standstill, units, closed chains."""

from __future__ import annotations

import numpy as np

from identification.data.checks.smoothed_copy import SmoothedRecording, included
from identification.data.recording import Recording, time_text, when
from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.errors import ChainError, LogError, listed
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import linear_joints

# Largest noise of any encoder [rad and m]: larger apparent noise is motion that is sampled at too low a rate.
_NOISIEST_ANGLE, _NOISIEST_LENGTH = 0.02, 0.005
# A warning is given if more than the first share of the samples in motion repeat the sample before, or if at least the
# second number of samples in a row do.
_FROZEN_SHARE, _FROZEN_RUN = 0.005, 5
# Repeated samples are an error only if the joint moves before and after them: over at least the first number of samples
# on either side, faster than the second share of its speed during the repeated samples.
_AROUND_REPEATS, _AS_FAST = 4, 0.5
# The end of a recording is reported as standstill if it lasts at least this share of the recording, and this long [s].
_TAIL_SHARE, _TAIL_SECONDS = 0.05, 0.5
# An encoder step is estimated only from at least this number of changes of position, of which at least the same number
# differ from the change before.
_FEWEST_STEPS = 20
# A jump is a step that is more than the first number times as fast as each of the second number of steps before and
# after it, and opposite to the motion before and after.
_JUMP, _BESIDE = 6.0, 5
# Smallest jump: of an angle [rad], of a length [m], in encoder steps, and in standard deviations of the noise.
_LEAST_ANGLE, _LEAST_LENGTH, _JUMP_STEPS, _BEYOND_NOISE = 0.02, 0.002, 5.0, 10.0
# Number of samples that are searched at once, from the end of a recording on.
_PIECE = 10_000
# Ratio of the measured velocity to the derivative of the position, for units of the two that differ.
_UNIT_RATIOS = {
    180 / np.pi: "deg/s against rad",
    np.pi / 180: "rad/s against deg",
    30 / np.pi: "rpm against rad",
    1 / (2 * np.pi): "revolutions per second against rad",
    1e3: "mm/s against m",
}

# A passive joint is reported if its measured position differs from the computed one by more than this share of its
# travel: any encoder is more accurate.
_PASSIVE_SHARE = 0.01


def quantum(q: Float[Array, " N"]) -> float:
    """Encoder step [rad or m], estimated from the differences of ``q``; 0 if they are not multiples of one step.

    The step is also 0 if the differences hardly change: at constant speed they are equal, whatever the encoder step is.
    """
    q = np.ascontiguousarray(q)
    differences = np.diff(q)
    steps = np.abs(differences)
    steps = steps[steps > 1e-12 * max(np.max(np.abs(q)), 1e-9)]
    if len(steps) < _FEWEST_STEPS:
        return 0.0
    step = float(np.min(steps))
    # Small differences are rounded to whole numbers of steps, and the step is fitted to them by least squares, in turn.
    for _ in range(3):
        small = steps[steps < 50 * step]
        counts = np.round(small / step)
        step = float(np.sum(small * counts) / np.sum(counts**2)) if np.any(counts) else 0.0
        if step == 0:
            return 0.0
    small = steps[steps < 50 * step]
    distances = np.abs(small / step - np.round(small / step))
    if len(small) < _FEWEST_STEPS or np.percentile(distances, 95) >= 0.05:
        return 0.0
    return step if np.count_nonzero(np.diff(np.round(differences / step))) >= _FEWEST_STEPS else 0.0


def _noise(q: Float[Array, " N"]) -> float:
    """Standard deviation of white noise on ``q``, from third differences, which are small in a smooth motion."""
    # The third difference of white noise has 20 times its variance; 1.4826 times the median absolute value estimates
    # the standard deviation.
    third = np.diff(np.ascontiguousarray(q), 3)
    return float(1.4826 * np.median(np.abs(third)) / np.sqrt(20))


def position_noise(recording: Recording) -> Float[Array, " nv"]:
    """Standard deviation of the white noise of each joint's position [rad or m], shape ``(nv,)``."""
    return np.array([_noise(q) for q in _included_part(recording)[0].T])


def _noisiest(recording: Recording, prismatic: Bool[Array, " nv"] | None) -> Float[Array, " nv"]:
    """Largest plausible noise of each joint's encoder [rad or m], shape ``(nv,)``."""
    linear = np.zeros(recording.q.shape[1], dtype=bool) if prismatic is None else prismatic
    return np.where(linear, _NOISIEST_LENGTH, _NOISIEST_ANGLE)


def check_sampling(
    recording: Recording, prismatic: Bool[Array, " nv"] | None, noise: Float[Array, " nv"]
) -> tuple[str, ...]:
    """A warning on joints whose positions look like noise, because they oscillate too fast for the sample rate."""
    fast = noise > _noisiest(recording, prismatic)
    if not fast.any():
        return ()
    joints = listed([joint for joint, one in zip(recording.joint_names, fast, strict=True) if one])
    rate = 1 / float(np.median(np.diff(recording.t)))
    return (
        f"{recording.file}: the positions of {joints} jump about from sample to sample, so that neither speeds nor "
        f"accelerations can be had from them: record with far more than {rate:.3g} Hz, or move more slowly.",
    )


def _runs(mask: Array) -> list[tuple[int, int]]:
    """Start and end (exclusive) of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]])))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def check_frozen(recording: Recording, smooth: SmoothedRecording) -> tuple[str, ...]:
    """Warnings on positions that stay the same although the joint moves, and then jump to the true position."""
    out = []
    for j, joint in enumerate(recording.joint_names):
        q = recording.q[:, j]
        v = np.interp(recording.t, smooth.t, smooth.v[:, j])
        # Repeats are normal while the joint moves by less than a few encoder steps per sample.
        steps = np.abs(np.diff(q))
        least = float(np.percentile(steps[steps > 0], 5)) if (steps > 0).any() else 0.0
        step = quantum(q)
        moves = np.abs(v) * smooth.step > max(3 * step, least)
        held = _is_held(q)
        runs = []
        for start, stop in _runs(np.diff(q) == 0):
            if stop + 1 >= len(q):
                continue
            # The joint has to be in motion, and the jump after the repeats has to make up for most of the travel.
            travel = float(np.mean(v[start : stop + 1]) * (recording.t[stop + 1] - recording.t[start]))
            in_motion = moves[start : stop + 1].all() or (held and abs(travel) > 3 * max(step, least))
            jumps_on = in_motion and (q[stop + 1] - q[start]) / travel > 0.5
            if jumps_on and _moves_around(q, recording.t, start, stop, travel):
                runs.append((start, stop))
        if not runs:
            continue
        # Repeated samples are samples in motion, too, even if the joint is slow.
        for start, stop in runs:
            moves[start:stop] = True
        frozen = sum(stop - start for start, stop in runs)
        longest = max(runs, key=lambda run: run[1] - run[0])
        share = frozen / int(moves.sum())
        if share > _FROZEN_SHARE or longest[1] - longest[0] >= _FROZEN_RUN:
            out.append(
                f"{recording.file}: q of {joint} repeats {frozen} samples ({100 * share:.2g} % of those in motion) and "
                f"then jumps, the longest time for {longest[1] - longest[0] + 1} samples at "
                f"t = {time_text(float(recording.t[longest[0]]))} s: the encoder is read more slowly than it is "
                "logged, or stalls."
            )
    return tuple(out)


def _is_held(q: Float[Array, " N"]) -> bool:
    """True if positions are held for several rows each: more than half of the travel is in steps after repeats."""
    changes = np.flatnonzero(np.diff(q))
    travel = np.abs(q[changes + 1] - q[changes])
    return bool(np.sum(travel[1:][np.diff(changes) > 1]) > np.sum(travel) / 2)


def _moves_around(q: Float[Array, " N"], t: Float[Array, " N"], start: int, stop: int, travel: float) -> bool:
    """True if a joint moves in the same direction, and fast enough, before, during and after some equal samples.

    It is False for a joint that rests, starts, stops or reverses there. If every position is held, the speeds before
    and after are computed over at least as many rows as a position is held, and one more row for a longer hold.

    Args:
        q: Position [rad or m].
        t: Time [s].
        start: Index of the first equal sample.
        stop: Index of the last equal sample.
        travel: Change of position [rad or m] that is expected from ``start`` to the sample after ``stop``.
    """
    rows = max(_AROUND_REPEATS, stop - start + 2)
    first, last = start - rows, stop + 1 + rows
    if first < 0 or last >= len(q):
        return False
    speed = travel / (t[stop + 1] - t[start])
    before = (q[start] - q[first]) / (t[start] - t[first])
    after = (q[last] - q[stop + 1]) / (t[last] - t[stop + 1])
    return bool(min(before / speed, after / speed) > _AS_FAST)


def check_jumps(
    recording: Recording, prismatic: Bool[Array, " nv"] | None, noise: Float[Array, " nv"]
) -> tuple[str, ...]:
    """Warnings on positions that jump back from one sample to the next, as when a motor's encoder wraps around."""
    out, kept = [], included(recording)
    linear = np.zeros(recording.q.shape[1], dtype=bool) if prismatic is None else prismatic
    least = np.where(linear, _LEAST_LENGTH, _LEAST_ANGLE)
    for j, joint in enumerate(recording.joint_names):
        q = np.ascontiguousarray(recording.q[:, j])
        at = jumps(recording.t, q, max(float(least[j]), _JUMP_STEPS * quantum(q)), float(noise[j]))
        at = at[kept[at]]
        if len(at):
            size = float(np.abs(q[at] - q[at - 1]).max())
            times = "once" if len(at) == 1 else f"{len(at)} times"
            out.append(
                f"{recording.file}: q of {joint} jumps by up to {size:.3g} {'m' if linear[j] else 'rad'} from one "
                f"sample to the next, {times} ({when(recording.t[at])}), against the motion before and after: its "
                "encoder starts anew there or loses counts; give a position that goes on."
            )
    return tuple(out)


def jumps(t: Float[Array, " N"], q: Float[Array, " N"], least: float, noise: float) -> Array:
    """Indices of the first samples after jumps: steps far faster than those before and after, against the motion there.

    Args:
        t: Time [s].
        q: Position [rad or m].
        least: Smallest size of a jump [rad or m].
        noise: Standard deviation of the position's noise [rad or m].
    """
    steps = np.diff(q)
    speeds = np.abs(steps) / np.diff(t)
    # Most large steps of a fast joint are excluded here quickly: they are as fast as the steps next to them.
    faster = np.zeros(len(steps), dtype=bool)
    faster[1:-1] = speeds[1:-1] > _JUMP * np.maximum(speeds[:-2], speeds[2:])
    out = []
    for k in np.flatnonzero(faster & (np.abs(steps) > max(least, _BEYOND_NOISE * noise))) + 1:
        if not _BESIDE < k < len(q) - _BESIDE:
            continue
        neighbours = np.concatenate([speeds[k - 1 - _BESIDE : k - 1], speeds[k : k + _BESIDE]])
        travel_beside = np.array([q[k - 1] - q[k - 1 - _BESIDE], q[k + _BESIDE] - q[k]])
        against_jump = -np.sign(steps[k - 1]) * travel_beside
        if speeds[k - 1] > _JUMP * neighbours.max() and np.all(against_jump > _BEYOND_NOISE * noise):
            out.append(k)
    return np.array(out, dtype=int)


def check_coarse_step(recording: Recording, smooth: SmoothedRecording, stated: tuple[bool, ...]) -> tuple[str, ...]:
    """Warnings on coarse encoders: few steps in the whole range, or rounding that dominates the acceleration.

    Joints that are ``stated``, whose encoder step robot.yaml states, are not reported.
    """
    out = []
    share_kept = min(1.0, 2 * smooth.cutoff_hz * smooth.step)  # of the power of white noise, by the low pass
    for j, joint in enumerate(recording.joint_names):
        step = quantum(recording.q[:, j])
        extent = np.ptp(recording.q[:, j])
        if stated[j] or step == 0 or extent < 3 * step:
            continue
        # Rounding is taken as low-passed white noise. The power density of its acceleration is proportional to the
        # fourth power of the frequency, the mean of which below the cut-off is a fifth of the value at the cut-off.
        noise = step / np.sqrt(12) * np.sqrt(share_kept / 5) * (2 * np.pi * smooth.cutoff_hz) ** 2
        motion = float(np.sqrt(np.mean(smooth.a[smooth.inside, j] ** 2))) if smooth.inside.any() else 0.0
        if extent < 100 * step or noise > 0.5 * motion:
            out.append(
                f"{recording.file}: the encoder of {joint} has the coarse step {step:.3g}, of which its whole motion "
                f"is {extent / step:.0f}: state encoder_counts in robot.yaml, and expect little from accelerations."
            )
    return tuple(out)


def still_joints(recording: Recording, prismatic: Bool[Array, " nv"] | None) -> Bool[Array, " nv"]:
    """True for joints that never move by more than noise and a few steps of the encoder.

    Args:
        recording: Raw samples.
        prismatic: True for linear joints; None if that is not known.
    """
    q, _ = _included_part(recording)
    if len(q) < 20:
        return np.zeros(q.shape[1], dtype=bool)
    return np.ptp(q, axis=0) <= _still_range(recording, prismatic, position_noise(recording))


def _included_part(recording: Recording) -> tuple[Float[Array, "n nv"], Float[Array, " n"]]:
    """Positions and times outside every excluded interval; not copied if there is no such interval."""
    if not recording.excluded:
        return recording.q, recording.t
    kept = included(recording)
    return recording.q[kept], recording.t[kept]


def _still_range(
    recording: Recording, prismatic: Bool[Array, " nv"] | None, noise: Float[Array, " nv"]
) -> Float[Array, " nv"]:
    """Largest range of positions of a joint that stands still [rad or m], shape ``(nv,)``."""
    return np.maximum(_least_motion(recording, prismatic), 2 * _tolerance(recording, prismatic, noise))


def _least_motion(recording: Recording, prismatic: Bool[Array, " nv"] | None) -> Float[Array, " nv"]:
    """Range of positions that counts as motion of each joint, whatever the noise is [rad or m], shape ``(nv,)``."""
    return np.where(prismatic, 1e-5, 1e-3) if prismatic is not None else np.full(recording.q.shape[1], 1e-5)


def _tolerance(
    recording: Recording, prismatic: Bool[Array, " nv"] | None, noise: Float[Array, " nv"]
) -> Float[Array, " nv"]:
    """Largest distance of each joint at rest from its resting position [rad or m], shape ``(nv,)``."""
    noise = np.minimum(noise, _noisiest(recording, prismatic))
    wander = 5 * noise + np.array([2 * quantum(q) + 1e-4 * np.ptp(q) for q in _included_part(recording)[0].T])
    return np.maximum(wander, 0.1 * _least_motion(recording, prismatic))


def _last_away(q: Float[Array, "N nv"], place: Float[Array, " nv"], far: Float[Array, " nv"]) -> int:
    """Index of the last sample at which any joint is farther than ``far`` from ``place``; -1 without such a sample.

    The search goes backwards from the end in pieces, because this sample is mostly near the end.
    """
    for stop in range(len(q), 0, -_PIECE):
        first = max(stop - _PIECE, 0)
        away = np.flatnonzero((np.abs(q[first:stop] - place) > far).any(axis=1))
        if len(away):
            return first + int(away[-1])
    return -1


def check_stillness(recording: Recording, prismatic: Array | None, noise: Float[Array, " nv"]) -> tuple[str, ...]:
    """Warnings on joints that never move, and on an end of the recording in which no joint moves."""
    out = []
    q, t = _included_part(recording)
    if len(q) < 20:
        return ()
    still = np.ptp(q, axis=0) <= _still_range(recording, prismatic, noise)
    for joint in np.array(recording.joint_names)[still]:
        out.append(f"{recording.file}: {joint} never moves, so this recording shows nothing about it.")
    if still.all():
        return tuple(out)
    after = _last_away(q, np.median(q[-20:], axis=0), _tolerance(recording, prismatic, noise)) + 1
    start = t[after] if after < len(t) else t[-1]
    if t[-1] - start >= max(_TAIL_SECONDS, _TAIL_SHARE * (t[-1] - t[0])):
        out.append(
            f"{recording.file}: no joint moves from t = {time_text(start)} s to the end at t = {time_text(t[-1])} s: "
            f"leave it out with --exclude {time_text(start)}:{time_text(t[-1])}."
        )
    return tuple(out)


def check_velocity(recording: Recording, smooth: SmoothedRecording) -> tuple[str, ...]:
    """Warnings on measured velocities that are not the derivative of the measured position."""
    if smooth.v_measured is None:
        return ()
    out = []
    for j, joint in enumerate(recording.joint_names):
        v, measured = smooth.v[smooth.inside, j], smooth.v_measured[smooth.inside, j]
        power = float(v @ v)
        noise = _noise(recording.q[:, j]) + quantum(recording.q[:, j])
        if not len(v) or power == 0 or np.sqrt(power / len(v)) < 20 * noise * smooth.cutoff_hz:
            continue
        ratio = float(measured @ v) / power
        scale = np.sqrt(power * float(measured @ measured))
        agreement = float(measured @ v) / scale if scale > 0 else 0.0
        sentence = _velocity_sentence(ratio, agreement)
        if sentence is not None:
            out.append(f"{recording.file}: the measured velocity of {joint} {sentence}")
    return tuple(out)


def _velocity_sentence(ratio: float, agreement: float) -> str | None:
    """End of the warning on a measured velocity that is not the derivative of the position; None if it is.

    Args:
        ratio: Slope of the measured velocity over the derivative.
        agreement: Correlation of measured velocity and derivative.
    """
    if abs(agreement) < 0.7:
        return f"does not follow the derivative of its position (correlation {agreement:.2f}): is it of another joint?"
    for factor, unit in _UNIT_RATIOS.items():
        if abs(abs(ratio) / factor - 1) < 0.15:
            return f"is {ratio:.3g} times the derivative of its position: the units differ ({unit})."
    if ratio < 0:
        return f"has the opposite sign of the derivative of its position (ratio {ratio:.2f}): flip one of them."
    if abs(ratio - 1) > 0.15:
        return f"is {ratio:.3g} times the derivative of its position: check its unit and the gear ratio."
    return None


def check_passive(recording: Recording, robot: Robot) -> tuple[str, ...]:
    """Warnings on passive joints whose measured position differs from the position that the closed chain determines.

    Raises:
        LogError: If the loops do not close at the recorded positions of the active joints.
    """
    if robot.chain is None or not (robot.chain.anchors or recording.passive_q):
        return ()
    try:
        tree = robot.solutions.at(recording.q).x
    except ChainError as problem:
        raise LogError(f"{recording.file}: {problem}") from problem
    slides = linear_joints(robot.model)
    out = []
    for joint, place in zip(robot.passive_names, robot.chain.passive, strict=True):
        if joint not in recording.passive_q:
            continue
        distance = recording.passive_q[joint] - tree[:, place]
        linear = bool(slides[place])
        if not linear:
            distance = np.mod(distance + np.pi, 2 * np.pi) - np.pi
        rms = float(np.sqrt(np.mean(distance**2)))
        if rms > _PASSIVE_SHARE * np.ptp(tree[:, place]):
            out.append(
                f"{recording.file}: the measured position of {joint} is {rms:.3g} {'m' if linear else 'rad'} (rms) "
                f"from where the loops of {robot.name} put it: look at its sign, its zero and the loops in robot.yaml."
            )
    return tuple(out)
