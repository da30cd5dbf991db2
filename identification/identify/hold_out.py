"""Splits recordings into data for the fit and held-out data, and computes the errors of the fit on held-out data."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from identification.data.checks.positions import still_joints
from identification.data.log import Log
from identification.data.recording import Recording, time_text
from identification.data.signals import choose_cutoff, process, uniform, within_limits
from identification.estimators.fit import Fit, relative_rms
from identification.identify.identification import Evidence, JointError
from identification.regression.regressor import Regressor
from identification.reporting.charts.thinning import gap_starts
from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.errors import IdentifiabilityError, LogError
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion
from phantom_dyn.signals.spectra import power_density

SHARE = 0.2
"""Share of a single recording, at its end, that is held out."""

_EQUATIONS = 2.0  # smallest number of equations per unknown: with fewer, standard deviations are not reliable
_ROUGH = 0.25  # a larger relative standard deviation of an error on held-out data causes a warning

_BETWEEN = 20  # number of sample times between two recordings on the time axis, so that figures show a gap
_LONGEST, _SHORTEST = 1024, 64  # largest and smallest number of samples in a segment of the spectra


@dataclass(frozen=True)
class Split:
    """Data for the fit, and held-out data.

    Attributes:
        train: Logs for the fit.
        test: Logs that no fit uses.
        words: The held-out data in words, such as ``the last 20 % of log.csv (from 22 s on)``.
        cutoff_hz: Upper edge of the band [Hz].
    """

    train: tuple[Log, ...]
    test: tuple[Log, ...]
    words: str
    cutoff_hz: float


def split_logs(robot: Robot, recordings: tuple[Recording, ...], hold_out: tuple[Recording, ...] = ()) -> Split:
    """Logs for the fit and held-out logs, all in one band.

    The recordings of ``hold_out`` are held out if they are given. Otherwise the last one of several recordings is held
    out, or the end of a single recording. No filtered sample depends on samples of both parts.

    Args:
        robot: The robot.
        recordings: One recording or more.
        hold_out: Recordings that no fit may use.

    Raises:
        LogError: If a recording is too short for its band, or all of it is excluded.
        IdentifiabilityError: If no joint moves in the recordings for the fit.
    """
    every = (*recordings, *hold_out)
    cutoff = _common_cutoff(every)
    still = [still_joints(recording, robot.prismatic) for recording in every]
    if all(joints.all() for joints in still[: len(recordings)]):
        raise IdentifiabilityError(
            f"{' and '.join(Path(recording.file).name for recording in recordings)}: no joint moves, so nothing can be "
            "identified: record a motion."
        )
    logs = tuple(process(recording, robot, cutoff_hz=cutoff) for recording in every)
    logs = tuple(
        replace(log, tau=_joint_torque(log, robot), motion=_held_at_standstill(log.motion, joints))
        for log, joints in zip(logs, still, strict=True)
    )
    if hold_out:
        names = " and ".join(Path(recording.file).name for recording in hold_out)
        return Split(logs[: len(recordings)], logs[len(recordings) :], names, cutoff)
    if len(logs) == 1:
        return _end_of(logs[0], cutoff)
    return Split(logs[:-1], logs[-1:], f"{Path(logs[-1].file).name}, the last of {len(logs)} recordings", cutoff)


def _joint_torque(log: Log, robot: Robot) -> Float[Array, "N nv"]:
    """Torque on the joints: drive torque, clipped at the limits of the drives, plus the torque of measured forces."""
    tau = within_limits(log.tau, robot)
    return tau if log.external is None else tau + log.external


def require_enough(robot: Robot, split: Split, unknowns: int) -> None:
    """Raise an error for fewer than two equations per unknown, or for too few held-out samples.

    Args:
        robot: The robot; each sample is one equation per joint.
        split: Data for the fit, and held-out data.
        unknowns: Number of parameters that some motion of the robot can identify.

    Raises:
        LogError: The message states the band, the number of samples, and how to get more.
    """
    for_fit = int(np.ceil(_EQUATIONS * max(unknowns, 1) / robot.nv))
    for_test = max(2, int(np.ceil(SHARE / (1 - SHARE) * for_fit)))
    for part, wanted, purpose in ((split.train, for_fit, "to fit"), (split.test, for_test, "to judge on")):
        samples = _count(part)
        if samples < wanted:
            files = " and ".join(Path(log.file).name for log in part)
            raise LogError(
                f"{files}: {samples} independent samples are left {purpose}, wanted {wanted} for {unknowns} parameters "
                f"of {_joints(robot)}: motion and torque stand above their noise up to {split.cutoff_hz:.2g} Hz, which "
                f"makes {max(log.band.output_rate_hz for log in part):.2g} such samples a second; record more or "
                "faster motion, exclude less, or fit fewer parameters (--friction)."
            )


def caution(split: Split) -> tuple[str, ...]:
    """A warning if the errors on held-out data are estimated from few samples."""
    samples = _count(split.test)
    # Relative standard deviation of the root mean square of n independent numbers.
    rough = 1 / np.sqrt(2 * max(samples, 1))
    if rough <= _ROUGH:
        return ()
    return (
        f"The errors on held-out data rest on {samples} independent samples (band 0 to {split.cutoff_hz:.2g} Hz) and "
        f"are known to about {100 * rough:.0f} %: record more, or name a recording to judge on with --hold-out.",
    )


def _count(logs: tuple[Log, ...]) -> int:
    """Number of independent samples of several logs."""
    return sum(int(log.valid_in_band.sum()) for log in logs)


def _joints(robot: Robot) -> str:
    """Number of joints in words."""
    return "one joint" if robot.nv == 1 else f"{robot.nv} joints"


def _held_at_standstill(motion: Motion, still: Bool[Array, " nv"]) -> Motion:
    """The motion with zero velocity for joints that never move: otherwise their friction has the sign of noise."""
    q = np.where(still, np.median(motion.q, axis=0), motion.q)
    return motion.with_joints(q, np.where(still, 0.0, motion.v), np.where(still, 0.0, motion.a))


def _end_of(log: Log, cutoff_hz: float) -> Split:
    """Split of a single log, whose end is held out."""
    usable = log.motion.t[log.valid]
    if not len(usable):
        raise LogError(f"{log.file}: every sample is excluded: leave some of them.")
    start = float(np.quantile(usable, 1 - SHARE))
    before = log.motion.t < start
    words = f"the last {100 * SHARE:.0f} % of {Path(log.file).name} (from {time_text(round(start, 1))} s on)"
    train, test = replace(log, valid=log.valid & before), replace(log, valid=log.valid & ~before)
    return Split((train,), (test,), words, cutoff_hz)


def _common_cutoff(recordings: tuple[Recording, ...]) -> float:
    """Edge of a band for all recordings [Hz]."""
    signals = []
    for recording in recordings:
        t, q, tau, _ = uniform(recording)
        signals.append((q, tau, (len(t) - 1) / (t[-1] - t[0])))
    return choose_cutoff(signals)


def joint_errors(
    robot: Robot,
    measured: Float[Array, "N nv"],
    predicted: Float[Array, "N nv"],
    given: Float[Array, "N nv"],
    fitted: Float[Array, " nv"],
) -> tuple[JointError, ...]:
    """Torque errors of every joint on held-out samples.

    Args:
        robot: The robot.
        measured: Measured torque in the band [N m or N], shape ``(N, nv)``.
        predicted: Torque predicted by the fit [N m or N], shape ``(N, nv)``.
        given: Torque of the given model [N m or N], shape ``(N, nv)``.
        fitted: Relative error on the samples of the fit [%], shape ``(nv,)``.
    """
    rms = np.sqrt(np.mean((measured - predicted) ** 2, axis=0))
    relative, relative_given = (relative_rms(measured - model, measured) for model in (predicted, given))
    return tuple(
        JointError(
            joint,
            unit,
            float(rms[j]),
            float(relative[j]),
            float(relative_given[j]),
            float(fitted[j]) / 100,
            len(measured),
        )
        for j, (joint, unit) in enumerate(zip(robot.joint_names, robot.torque_units, strict=True))
    )


def held_out_evidence(given: Robot, fitted: Robot, fit: Fit, logs: tuple[Log, ...]) -> Evidence:
    """Torques and spectra on held-out logs.

    Args:
        given: The robot as its file states it.
        fitted: The robot on which the fit was based. Its friction and rotor inertias are zero where they were fitted.
        fit: The fit.
        logs: Logs with at least one valid sample in the band.
    """
    times, torques, pieces = [], [], []
    start = 0.0
    for log in logs:
        log_torques = [log.tau, fit.predict(fitted, log.motion), inverse_dynamics(given, log.motion)]
        torques.append([Regressor.in_band(log, values) for values in log_torques])
        t = log.motion.t[log.samples][log.valid_in_band]
        # The first recording keeps its times. Each other one is shifted, so that it begins after a gap.
        shift = start - t[0] if times and len(t) else 0.0
        times.append(t + shift)
        if len(t):
            start = float(t[-1] + shift) + _BETWEEN * log.band.step / log.band.rate_hz
        pieces += _stretches(log, log_torques[0], log_torques[0] - log_torques[1])
    measured, predicted, model = (np.concatenate([torque[k] for torque in torques]) for k in range(3))
    return Evidence(np.concatenate(times), measured, predicted, model, *_densities(pieces))


def _stretches(log: Log, measured: Array, residual: Array) -> list[tuple[float, Array]]:
    """Sample rate, and both signals side by side, shape ``(n, 2 nv)``, of every stretch of valid samples."""
    t = log.motion.t[log.valid]
    both = np.hstack([measured, residual])[log.valid]
    return [(log.band.rate_hz, both[a:b]) for a, b in pairwise([0, *gap_starts(t).tolist(), len(t)])]


def _densities(
    pieces: list[tuple[float, Array]],
) -> tuple[Float[Array, " F"], Float[Array, "F nv"], Float[Array, "F nv"]]:
    """Frequencies, and amplitude densities of measured torque and residual, averaged over all long enough stretches."""
    nv = pieces[0][1].shape[1] // 2
    rate, longest = max(((rate, len(piece)) for rate, piece in pieces), key=lambda one: one[1])
    length = min(_LONGEST, longest // 2 if longest >= 2 * _SHORTEST else longest)
    if length < _SHORTEST:
        return np.zeros(0), np.zeros((0, nv)), np.zeros((0, nv))
    power, weight, f = 0.0, 0, np.zeros(0)
    for piece_rate, piece in pieces:
        # A stretch with another sample rate would have other frequencies.
        if len(piece) >= length and abs(piece_rate - rate) < 1e-3 * rate:
            f, density = power_density(piece, rate, length)
            power, weight = power + len(piece) * density, weight + len(piece)
    amplitude = np.sqrt(power / weight)[1:]  # without the mean
    return f[1:], amplitude[:, :nv], amplitude[:, nv:]
