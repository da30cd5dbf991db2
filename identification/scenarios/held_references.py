"""Detects drives that hold each reference for a row of the log, and removes the response to its steps.

A held reference (zero-order hold) acts half a row late on average. It also jumps at every row, and the joint responds
to each jump. As the log has one sample per row, this response is aliased to the frequencies of the motion, where it
looks like a torque that couples the joints. It is linear in the references, follows from gains and inertia, and is
subtracted from the positions.

Simulated environments often log the positions after a step beside the action of that step. Each reference then acts in
the row before its own.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identification.data.checks.readings.plausible_fit import unexplained
from identification.data.checks.readings.reading import Reading
from identification.data.recording import Recording
from identification.data.signals import holds_references, process
from identification.data.stretches import busiest
from identification.notes import Code, Note
from phantom_dyn.array_types import Array, Float, read_only
from phantom_dyn.dynamics.dynamics import mass_matrix
from phantom_dyn.errors import ChainError, LogError
from phantom_dyn.model.robot import Robot

# Largest multiple of the sampling frequency, of either sign, whose spectral image of a held reference counts.
_IMAGES = 3
# Number of rows by which references are extended at both ends.
_PADDING = 200
# Rows are even if the standard deviation of the times between them is at most this share of the median.
_UNEVENNESS = 0.05
# Postures over which the inertia is averaged.
_POSTURES = 50
# References count as held if this lowers the logarithm of the unexplained torque by the first number or more on average
# over all joints and both halves of the log, and raises it by at most the second number in each.
_LEAST_GAIN, _LARGEST_LOSS = 0.3, 0.2
# Delays of the references [rows] that held references must outperform; a hold delays them by half a row on average.
_OTHER_DELAYS = (0.25, 0.75)
# Advances [rows] of references that act in the row before their own (at once, or held), and other advances, which must
# explain the torque less well. A drive that uses the velocity of the reference looks advanced, too.
_STEP_BEFORE, _OTHER_ADVANCES = (1.0, 0.5), (0.0, 1.75)
# Time between rows [s] below which a hold does not matter: half a row is less than the usual delay of a drive, and the
# steps hardly move a joint.
_SHORTEST_ROW = 0.004
# Largest number of joints: with more, the detection would take longer than a diagnosis.
_MOST_JOINTS = 12


def with_held_references(robot: Robot, recording: Recording) -> Recording:
    """The recording with references marked as held if the log shows it, and with the response to their steps removed.

    Args:
        robot: The given model. Its statement of how references act, if there is one, is taken as true.
        recording: Recording whose torque is that of the controllers.

    Returns:
        The recording, with a note if the log shows held references that the robot does not state. The step response is
        computed with the inertia of the model. It is subtracted only if this reduces the unexplained torque.
    """
    gain, q_ref = recording.reference_gain, recording.q_ref
    if gain is None or q_ref is None or not gain.any() or robot.nv > _MOST_JOINTS or not _has_slow_even_rows(recording):
        return recording
    stated = holds_references(recording, robot)
    how_is_stated = robot.reference_hold is not None or robot.torque_hold == "zoh"
    if how_is_stated and not stated:
        return recording
    if not how_is_stated:
        recording = _with_references_in_their_step(robot, recording)
    compared = busiest(recording)
    held = replace(compared, references_held=True)
    try:
        steps_show = _has_step_response(robot, held)
        if not stated:
            smooth = without_step_response(robot, held) if steps_show else held
            if not _references_are_held(robot, compared, smooth):
                return recording
    except (ChainError, LogError):
        return recording
    recording = without_step_response(robot, recording) if steps_show else recording
    if stated:
        return recording
    row_time = float(np.median(np.diff(recording.t)))
    note = Note(Code.HELD_SEEN, numbers={"file": recording.file, "row": row_time})
    return replace(recording, references_held=True, notes=(*recording.notes, note))


def _with_references_in_their_step(robot: Robot, recording: Recording) -> Recording:
    """The recording with each reference moved to the row before, and a note, if references act in the row before."""
    compared = busiest(recording)
    try:
        as_recorded = unexplained_torque(robot, compared)
        gains = {
            rows: np.log(as_recorded / unexplained_torque(robot, _delayed(compared, -rows)))
            for rows in (*_STEP_BEFORE, *_OTHER_ADVANCES)
        }
    except (ChainError, LogError):
        return recording
    best = max(_STEP_BEFORE, key=lambda rows: gains[rows].mean())
    least = max(_LEAST_GAIN, *(gains[rows].mean() for rows in _OTHER_ADVANCES))
    if gains[best].mean() <= least or gains[best].min() < -_LARGEST_LOSS:
        return recording
    row_time = float(np.median(np.diff(recording.t)))
    note = Note(Code.REFERENCE_OF_STEP, numbers={"file": recording.file, "row": row_time})
    return replace(_delayed(recording, -1.0), notes=(*recording.notes, note))


def _has_slow_even_rows(recording: Recording) -> bool:
    """True if the rows are evenly spaced in time, and far enough apart for steps to matter."""
    steps = np.diff(recording.t)
    return bool(np.std(steps) < _UNEVENNESS * np.median(steps) and np.median(steps) >= _SHORTEST_ROW)


def _has_step_response(robot: Robot, held: Recording) -> bool:
    """True if the unexplained torque is smaller after the response to the steps of held references is removed."""
    smooth = without_step_response(robot, held)
    improvements = np.log(unexplained_torque(robot, held) / unexplained_torque(robot, smooth))
    return bool(improvements.mean() > 0 and improvements.min() > -_LARGEST_LOSS)


def _references_are_held(robot: Robot, recording: Recording, held: Recording) -> bool:
    """True if held references explain the torque far better than undelayed ones, and better than delayed ones."""
    undelayed = unexplained_torque(robot, recording)
    improvements = np.log(undelayed / unexplained_torque(robot, held))
    by_delay = [np.mean(np.log(undelayed / unexplained_torque(robot, _delayed(recording, x)))) for x in _OTHER_DELAYS]
    return bool(improvements.mean() > max(_LEAST_GAIN, *by_delay) and improvements.min() >= -_LARGEST_LOSS)


def unexplained_torque(robot: Robot, recording: Recording) -> Float[Array, "2 nv"]:
    """Root mean square of the torque that no plausible robot explains, in each half of a recording [N m or N]."""
    log = process(recording, robot)
    motion, band = log.motion, log.band
    # The band filters torques and not the motion, because weight and inertia depend nonlinearly on the posture.
    reading = Reading(motion, np.sign(motion.v), log.tau, np.zeros_like(log.tau))
    shares, tau = unexplained(robot, reading, band=band), band(log.tau)
    half = len(tau) // 2
    variances = np.array([tau[:half].var(axis=0), tau[half:].var(axis=0)])
    # A half in which a torque hardly varies has no information. Its value is one, so that it cancels in every ratio.
    return np.where(np.isnan(shares), 1.0, np.sqrt(np.maximum(shares, 1e-12) * np.maximum(variances, 1e-300)))


def _delayed(recording: Recording, rows: float) -> Recording:
    """The recording with its references, and the torque that they command, delayed by a number of rows.

    Args:
        recording: Recording whose torque is that of the controllers.
        rows: Number of rows; negative if the references come earlier.
    """
    assert recording.q_ref is not None
    assert recording.tau is not None
    assert recording.reference_gain is not None
    row = np.arange(len(recording.t))
    q_ref = np.column_stack([np.interp(row - rows, row, column) for column in recording.q_ref.T])
    tau = recording.tau + recording.reference_gain * (q_ref - recording.q_ref)
    return replace(recording, q_ref=read_only(q_ref), tau=read_only(tau))


def without_step_response(robot: Robot, recording: Recording) -> Recording:
    """The recording with the positions and torques that smooth references with the same mean would have given."""
    assert recording.q_ref is not None
    assert recording.tau is not None
    assert recording.reference_gain is not None
    t = recording.t
    kd = np.zeros(robot.nv) if recording.velocity_gain is None else recording.velocity_gain
    postures = recording.q[:: max(len(t) // _POSTURES, 1)]
    mobility = np.linalg.inv(mass_matrix(robot, postures)).mean(axis=0)
    step = float(np.median(np.diff(t)))
    response = aliased_step_response(np.linalg.inv(mobility), recording.reference_gain, kd, step, recording.q_ref)
    tau = recording.tau + recording.reference_gain * response + kd * np.gradient(response, t, axis=0)
    return replace(recording, q=read_only(recording.q - response), tau=read_only(tau))


def aliased_step_response(
    M: Float[Array, "nv nv"], kp: Float[Array, " nv"], kd: Float[Array, " nv"], step: float, q_ref: Float[Array, "N nv"]
) -> Float[Array, "N nv"]:
    """Positions of joints under held references at the rows, minus those under smooth references [rad or m].

    A reference ``u`` that is held for ``T`` has the spectrum of ``u`` times ``sinc(f T) exp(-i pi f T)`` at all
    frequencies ``f + m / T``. The images with ``m`` other than zero are its steps. The response of the joints to them
    is ``(M s^2 + kd s + kp)^-1 kp``. Sampling once a row aliases all images to the frequency ``f``, where they add.

    Args:
        M: Mass matrix of the joints [kg m^2 or kg].
        kp: Position gains of the controllers [N m/rad or N/m].
        kd: Velocity gains of the controllers [N m s/rad or N s/m].
        step: Time ``T`` between rows, for which each reference is held [s].
        q_ref: References [rad or m].
    """
    pad = min(len(q_ref) - 1, _PADDING)
    left_padding, right_padding = 2 * q_ref[0] - q_ref[pad:0:-1], 2 * q_ref[-1] - q_ref[-2 : -pad - 2 : -1]
    # The padding avoids a jump from the end to the start, as the discrete spectrum is that of a periodic signal.
    taper = np.sin(0.5 * np.pi * np.arange(pad) / pad)[:, None] ** 2
    middle = q_ref.mean(axis=0)
    padded = np.concatenate([taper * (left_padding - middle), q_ref - middle, taper[::-1] * (right_padding - middle)])
    spectrum, frequencies = np.fft.rfft(padded, axis=0), np.fft.rfftfreq(len(padded), step)
    out = np.zeros_like(spectrum)
    for m in (*range(-_IMAGES, 0), *range(1, _IMAGES + 1)):
        f = frequencies + m / step
        s = 2j * np.pi * f[:, None, None]
        driven = kp * spectrum * (np.sinc(f * step) * np.exp(-1j * np.pi * f * step))[:, None]
        out += np.linalg.solve(M * s**2 + np.diag(kd) * s + np.diag(kp), driven[:, :, None])[:, :, 0]
    return np.fft.irfft(out, len(padded), axis=0)[pad : pad + len(q_ref)]
