"""Makes a `Log` of a recording: uniform time, aligned torque, derivatives, and a band chosen from the data.

1. Resample to a uniform rate if the time steps are uneven.
2. Correct the delay of half a sample of a torque that is held between samples.
3. Low-pass the positions far above the band, so that the filter changes nothing inside the band; differentiate them.
4. Filter torque and regressor columns with the same linear-phase kernel, and decimate.

Filtering only the torque, or filtering accelerations twice, biases friction by one to several per cent. The edge of the
band is the frequency above which the spectra of motion and torque are mostly noise.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from identification.data.derivatives import MOTION_BAND, differentiate, edges_of_readings, motion_edge
from identification.data.drive_loop import delay_intervals
from identification.data.drives.arrivals import between_readings
from identification.data.drives.joint_torque import external_torque, voltage_bound
from identification.data.floating.base_columns import filtered_base, sensors_of_base
from identification.data.floating.swings import band_of_swings, touched_rows
from identification.data.log import Band, Log
from identification.data.recording import Recording, time_text
from phantom_dyn._kernels.fir import filtered
from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.dynamics.dynamics import active_friction, inverse_dynamics
from phantom_dyn.effects.operation import References
from phantom_dyn.effects.support.encoder_lattice import reading_step, stated_step
from phantom_dyn.errors import LogError
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion
from phantom_dyn.signals.band_edges import acceleration_edge, driven_edge, slow_motion_edge, torque_edge
from phantom_dyn.signals.recursive import low_pass_kernel
from phantom_dyn.signals.splines import interpolated

# Positions [rad or m], torques [N m or N] and rate [Hz] of one recording.
Signals = tuple[Float[Array, "_ nv"], Float[Array, "_ nv"], float]

# Largest edge of the band as a share of the sample rate. Recorders may log the held torque, its mean over a sample, or
# its value at the middle of the sample. At higher frequencies these differ by more than a per cent.
_HIGHEST = 0.06
_LOWEST_HZ, _WIDEST_HZ = 1.0, 50.0  # smallest edge of the judged band, and largest edge of the band of logs
# Samples after decimation per period of the band's edge: the smallest number without aliasing.
_SAMPLES_PER_PERIOD = 2.5
# Smallest number of decimated samples that can be fitted.
_FEWEST = 20
# The band is at least wide enough for this number of decimated samples, even if the drives cause no motion at its
# highest frequencies. A joint moves in about a third of the samples, and with these the gains of some fifty laws have
# to be distinguished from chance.
_ENOUGH = 300
# A time step is a gap if it is longer than `_GAP_STEPS` median steps. If steps are uneven, the limit is higher:
# `_GAP_STEPS` times the quantile `_LONG_STEPS` of the steps, but at most `_GAP_PERIODS` periods of the band's edge.
_GAP_STEPS = 5
_GAP_PERIODS = _GAP_STEPS * _HIGHEST
_LONG_STEPS = 0.75


def uniform(recording: Recording) -> tuple[Float[Array, " N"], Float[Array, "N nv"], Float[Array, "N nv"], Array]:
    """Time [s], positions, torques and a mask of valid samples, on a uniform grid with the recording's median step.

    If the steps are uneven, positions are interpolated by cubic splines, and torques linearly. Samples in a gap of more
    than five steps or in an excluded interval are not valid.
    """
    t = recording.t
    steps = np.diff(t)
    step = float(np.median(steps))
    tau = recording.tau
    if tau is None:
        raise LogError(f"{recording.file} has no torque, current or voltage: record one, or see --motion-only.")
    q = recording.q
    if t[-1] - t[0] > 3 * len(t) * step:
        k = int(np.argmax(steps))
        raise LogError(
            f"{recording.file}: the time jumps from {time_text(t[k])} to {time_text(t[k + 1])} s, a gap longer "
            "than the recording: give each part in a file of its own."
        )
    if np.max(np.abs(steps - step)) > 1e-3 * step:
        grid = np.arange(t[0], t[-1] + 1e-9 * step, step)
        q = CubicSpline(t, q)(grid)
        tau = interpolated(grid, t, tau)
        t = grid
    return t, q, tau, _valid(recording, t, _GAP_STEPS * step)


def interpolated_noise(t: Float[Array, " M"], grid: Float[Array, " N"]) -> tuple[float, float, float]:
    """Autocovariance at lags of 0, 1 and 2 grid steps of white noise of unit variance after linear interpolation.

    Neighbours on the grid are interpolated between the same readings. So their noise is correlated, and has less power
    at high frequencies. The sum over all lags, positive and negative, is the power density at frequency zero.

    Args:
        t: Times of the readings [s].
        grid: Times of the interpolated values [s].
    """
    if grid is t:
        return 1.0, 0.0, 0.0
    first = np.clip(np.searchsorted(t, grid, side="right") - 1, 0, len(t) - 2)
    # A value on the grid is a weighted mean of the readings `first` and `first + 1`.
    of_second = np.clip((grid - t[first]) / (t[first + 1] - t[first]), 0.0, 1.0)
    of_first = 1.0 - of_second
    out = [float(np.mean(of_first**2 + of_second**2))]
    for step in (1, 2):
        distance = first[step:] - first[:-step]
        both_shared = of_first[:-step] * of_first[step:] + of_second[:-step] * of_second[step:]
        one_shared = of_second[:-step] * of_first[step:]
        covariance = np.where(distance == 0, both_shared, np.where(distance == 1, one_shared, 0.0))
        out.append(float(np.mean(covariance)))
    return out[0], out[1], out[2]


def _valid(recording: Recording, t: Float[Array, " N"], longest: float) -> Bool[Array, " N"]:
    """True at times outside excluded intervals, and outside gaps of more than ``longest`` seconds between samples."""
    gaps = np.flatnonzero(np.diff(recording.t) > longest)
    valid = np.ones(len(t), dtype=bool)
    for start, stop in [*((recording.t[k], recording.t[k + 1]) for k in gaps), *recording.excluded]:
        valid &= (t < start) | (t > stop)
    return valid


def align_held_torque(tau: Float[Array, "N nv"]) -> Float[Array, "N nv"]:
    """Torque that acts at the sample instants if ``tau[k]`` is held from ``t[k]`` to ``t[k+1]``.

    A torque held over the sample time ``T`` acts half a sample late, and attenuated by ``sinc(f T)`` at the frequency
    ``f``. The mean of two neighbours has the same delay and too much attenuation. The weights -1, 13, 13, -1 over 24
    give the delay, and the attenuation to fourth order in ``f T``.
    """
    before = np.vstack([tau[:1], tau[:-1]])
    earlier = np.vstack([tau[:1], before[:-1]])
    later = np.vstack([tau[1:], tau[-1:]])
    return (13.0 * (tau + before) - earlier - later) / 24.0


def within_limits(tau: Float[Array, "N nv"], robot: Robot) -> Float[Array, "N nv"]:
    """Torque of the drives: commanded torque is clipped to the stated limits, measured torque is not changed."""
    if robot.torque_source != "command":
        return tau
    limits = np.array([np.inf if a.torque_limit is None else a.torque_limit for a in robot.actuators])
    return np.clip(tau, -limits, limits)


def low_pass(cutoff_hz: float, rate_hz: float) -> Band:
    """Hamming-windowed low pass, and decimation to at least 2.5 samples per period of its edge.

    The kernel extends two periods of the edge to either side. Signals are not filtered if the edge is 0.4 times the
    rate or more.
    """
    if cutoff_hz >= 0.4 * rate_hz:
        return Band(rate_hz, 0.5 * rate_hz, np.ones(1), 1)
    half = int(np.ceil(2 * rate_hz / cutoff_hz))
    step = int(rate_hz / (_SAMPLES_PER_PERIOD * cutoff_hz))
    return Band(rate_hz, cutoff_hz, low_pass_kernel(half, cutoff_hz, rate_hz), step)


def smoothed(x: Float[Array, "n ..."], rate_hz: float, cutoff_hz: float) -> Float[Array, "n ..."]:
    """``x`` low-passed at ``cutoff_hz``, of the same length; the series is mirrored at its ends."""
    band = low_pass(cutoff_hz, rate_hz)
    half = min(band.half, len(x) - 1)
    if half == 0:
        return x
    kernel = band.kernel[band.half - half : band.half + half + 1]
    padded = np.concatenate([x[half:0:-1], x, x[-2 : -half - 2 : -1]])
    flat = np.asarray(padded, dtype=float).reshape(len(padded), -1)
    return filtered(kernel / kernel.sum(), flat, 1).reshape(x.shape)


def narrowed(x: Float[Array, "n ..."], valid: Bool[Array, " n"], band: Band, cutoff_hz: float) -> Float[Array, "n ..."]:
    """Samples ``x`` of a band, low-passed to a narrower band; the same object if ``band`` is no wider than that.

    Each run of valid samples is filtered by itself, so that valid samples do not depend on interpolated values in gaps.
    Samples that are not valid become zero.
    """
    rate_hz = band.output_rate_hz
    if cutoff_hz >= 0.99 * band.cutoff_hz:
        return x
    if valid.all():
        return smoothed(x, rate_hz, cutoff_hz)
    out = np.zeros(x.shape)
    ends = np.flatnonzero(np.diff(np.concatenate([[False], valid, [False]])))
    for start, stop in ends.reshape(-1, 2).tolist():
        out[start:stop] = smoothed(x[start:stop], rate_hz, cutoff_hz)
    return out


def shortest_recording(band: Band) -> float:
    """Length [s] of the shortest recording that has enough decimated samples in ``band`` for a fit."""
    return (_FEWEST * band.step + 2 * band.half) / band.rate_hz


def process(recording: Recording, robot: Robot, *, cutoff_hz: float | None = None) -> Log:
    """The log of one recording; the band is chosen from the data unless it is given.

    Args:
        recording: Raw samples.
        robot: The robot, which states how the torque was held.
        cutoff_hz: Edge of the band [Hz]; None to choose it from the data.

    Raises:
        LogError: If the recording is too short for its band.
    """
    t, q, tau, valid = uniform(recording)
    rate = (len(t) - 1) / (t[-1] - t[0])
    q_ref = None if recording.q_ref is None else _on_grid(recording.t, recording.q_ref, t)
    held_references = holds_references(recording, robot)
    if q_ref is not None and held_references:
        held = align_held_torque(q_ref)
        references = _references(recording, robot, t, q_ref, q, _on_grid(recording.t, differences(recording), t))
        # The torque was computed as if each reference acted at its sample only. It is corrected for held references.
        tau = tau if references is None else tau + references.with_references(held)
        q_ref = held
    if robot.torque_hold == "zoh":
        tau = align_held_torque(tau)
    if cutoff_hz is None:
        cutoff_hz = choose_cutoff([(q, tau, rate)])
    band = low_pass(cutoff_hz, rate)
    if len(band.samples(len(t))) < _FEWEST:
        least = max(10.0, shortest_recording(band))
        raise LogError(
            f"{recording.file} lasts {t[-1] - t[0]:.2f} s, too short for a band of {band.cutoff_hz:.2g} Hz, where a "
            f"sample comes every {1 / rate:.3g} s: record at least {least:.2g} s of motion, or at a higher rate."
        )
    if not valid.all():
        median, long = np.quantile(np.diff(recording.t), [0.5, _LONG_STEPS])
        longest = max(_GAP_STEPS * median, min(_GAP_STEPS * long, _GAP_PERIODS / band.cutoff_hz))
        valid = _valid(recording, t, longest)
    # Encoder steps are found in the recorded positions, as interpolated ones are not multiples of them.
    steps = tuple(reading_step(column, stated_step(robot, j)) for j, column in enumerate(recording.q.T))
    edges = edges_of_readings(q, steps, valid, band)
    smooth, v, a = differentiate(q, rate, edges)
    if recording.velocity_gain is not None:
        tau = tau + recording.velocity_gain * (_on_grid(recording.t, differences(recording), t) - v)
    if recording.friction_subtracted:
        tau = tau + active_friction(robot, v) * np.isin(robot.joint_names, recording.friction_subtracted)
    temperature = None if recording.temperature is None else _on_grid(recording.t, recording.temperature, t)
    forces = {frame: _on_grid(recording.t, force, t) for frame, force in recording.forces.items()}
    references = None if q_ref is None else _references(recording, robot, t, q_ref, q, v)
    external = external_torque(robot, smooth, forces) if forces else None
    base = None if recording.base is None else filtered_base(recording, robot, t, rate, motion_edge(band))
    motion = Motion(t, smooth, v, a, base=base)
    fields = (q, q_ref, external, steps, temperature, references, touched_rows(recording, robot, t))
    between = between_readings(recording, robot, t, held_references)
    tau = tau if between is None else tau + between.torque
    arrival = (None, None) if between is None else (between.arrival, between.nonlinear_std)
    sensors, noise = sensors_of_base(recording), interpolated_noise(recording.t, t)
    return Log(
        recording.file, recording.joint_names, motion, tau, band, valid, *fields, sensors, *arrival, noise, edges
    )


def holds_references(recording: Recording, robot: Robot) -> bool:
    """True if each reference is held until the next sample.

    The result is False if the torque is held, because `align_held_torque` of the torque then corrects both holds.
    """
    stated = robot.reference_hold
    held = recording.references_held if stated is None else stated == "zoh"
    return held and robot.torque_hold != "zoh"


def differences(recording: Recording) -> Float[Array, "N nv"]:
    """Velocities [rad/s or m/s]: finite differences of the recorded positions, not filtered."""
    return np.gradient(recording.q, recording.t, axis=0)


def _references(
    recording: Recording, robot: Robot, t: Float[Array, " N"], q_ref: Array, q: Array, v: Array
) -> References | None:
    """The references and the torque that they command, if the torque was computed from references; else None."""
    gain, limits = recording.reference_gain, recording.reference_torque_limit
    if gain is None or limits is None:
        return None
    # A limit of the torque clips the controller's damping too. A limit of the voltage does not clip the back-EMF.
    clips = recording.controlled & np.isinf([voltage_bound(actuator) for actuator in robot.actuators])
    damping = np.zeros(len(gain)) if recording.velocity_gain is None else np.where(clips, recording.velocity_gain, 0.0)
    commanded = gain * (q_ref - q) - damping * v
    if robot.torque_hold == "zoh":
        q_ref, commanded = align_held_torque(q_ref), align_held_torque(commanded)
    frame = float(np.median(np.diff(recording.t))) if holds_references(recording, robot) else 0.0
    return References(t, q_ref, commanded, gain, limits, *delay_intervals(recording.loops, len(gain), frame))


def _on_grid(t: Array, columns: Array, grid: Array) -> Array:
    """Columns interpolated linearly from times ``t`` to ``grid``; for quantities that need not be smooth."""
    return columns if grid is t else interpolated(grid, t, columns)


def process_all(recordings: tuple[Recording, ...], robot: Robot, factor: float = 1.0) -> tuple[tuple[Log, ...], float]:
    """Logs of several recordings, all in one band, and the edge [Hz] of the narrower band in which gaps are judged.

    `choose_cutoff` gives the edge of the judged band. The edge of the logs is up to four times as high (at most 50 Hz,
    6 % of the rate, and the edge of the recorder's own filter). Abrupt effects such as friction have content between
    the two edges. A fit can use this content if it weights each frequency by its noise (whitening).

    Args:
        recordings: Raw samples.
        robot: The robot, which states how the torque was held.
        factor: Factor of the judged band's edge, for a second judgement in a narrower or wider band.
    """
    raw = [uniform(recording) for recording in recordings]
    rates = [(len(t) - 1) / (t[-1] - t[0]) for t, *_ in raw]
    signals = [(q, tau, rate) for (_, q, tau, _), rate in zip(raw, rates, strict=True)]
    # A recorder does not smooth a torque that is computed from references. This torque does not limit the judged band
    # either, because a position servo commands little torque at high frequencies even where the robot moves.
    controlled = all(recording.controlled for recording in recordings)
    recorder = np.inf if controlled else max(torque_edge(column, rate) for _, tau, rate in signals for column in tau.T)
    widest = min(_WIDEST_HZ, _HIGHEST * min(rates), recorder)
    judged = _within_rate(_moving_edge(signals), signals) if controlled else choose_cutoff(signals)
    wide = max(judged, min(4 * judged, widest))
    # Legs are also moved by contact forces, so that `_driven_edge` does not apply to them.
    driven = (
        np.inf if controlled or robot.floating else max(_driven_edge(robot, signals, wide), _least_edge(recordings))
    )
    judged, wide = min(judged, driven), min(wide, 1.3 * driven)
    if (swings := band_of_swings(recordings, robot, judged)) is not None:
        judged = wide = swings
    elif factor != 1.0:
        judged = float(np.clip(factor * judged, _LOWEST_HZ, max(min(widest, driven), _LOWEST_HZ)))
        wide = max(judged, min(4 * judged, widest, 1.3 * driven))
    return tuple(process(recording, robot, cutoff_hz=wide) for recording in recordings), judged


def _least_edge(recordings: tuple[Recording, ...]) -> float:
    """Smallest edge [Hz] with which all recordings together have `_ENOUGH` decimated samples."""
    seconds = sum(float(recording.t[-1] - recording.t[0]) for recording in recordings)
    return _ENOUGH / (_SAMPLES_PER_PERIOD * seconds)


def _driven_edge(robot: Robot, signals: list[Signals], cutoff_hz: float) -> float:
    """Edge [Hz] above which the drives do not cause the motion: median of `driven_edge` over the moving joints.

    Motion above this edge is caused by disturbances or encoder noise. Torque and acceleration have opposite signs
    there, so that a fit would find a negative inertia, or a delay.
    """
    q, tau, rate = max(signals, key=lambda signal: len(signal[0]))
    smooth, v, a = differentiate(q, rate, min(MOTION_BAND * cutoff_hz, 0.4 * rate))
    model = inverse_dynamics(robot, Motion(np.arange(len(q)) / rate, smooth, v, a))
    moving = np.ptp(q, axis=0) > 1e-6
    edges = [driven_edge(tau[:, j], model[:, j], rate, cutoff_hz) for j in np.flatnonzero(moving)]
    return float(np.median(edges)) if edges else np.inf


def choose_cutoff(signals: list[Signals]) -> float:
    """Edge of the band [Hz] in which the signals are more than noise: the lower one of two frequencies.

    The first is the median, over moving joints, of the frequency up to which the acceleration is 10 dB above its noise
    floor. The second is the frequency above which the torque has less than 1 % of its amplitude. There the recorder has
    smoothed the torque, so that steps of friction are missing in the measured torque but not in the modelled one.
    """
    torque = max(torque_edge(column, rate) for _, tau, rate in signals for column in tau.T)
    return _within_rate(min(_moving_edge(signals), torque), signals)


def _within_rate(edge: float, signals: list[Signals]) -> float:
    """The edge [Hz], but at least 1 Hz, and at most `_HIGHEST` times the lowest sample rate."""
    return float(np.clip(edge, _LOWEST_HZ, _HIGHEST * min(rate for *_, rate in signals)))


def _moving_edge(signals: list[Signals]) -> float:
    """Median, over moving joints, of the frequency [Hz] up to which the acceleration is more than noise.

    If the spectrum resolves the motion of no joint, `slow_motion_edge` is used. The result is infinite without motion.
    """
    for edge_of in (acceleration_edge, slow_motion_edge):
        moving = [edge_of(column, rate) for q, _, rate in signals for column in q.T]
        edges = [edge for edge in moving if edge is not None]
        if edges:
            return float(np.median(edges))
    return np.inf
