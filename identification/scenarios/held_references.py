"""References that a drive holds from row to row: whether a log shows that, and how the joints answer their steps.

A held reference acts half a row late. It also jumps at every row, and the joint answers each jump. Between the rows
nobody sees the answer, but a log that is read once a row shows it at other frequencies than it has: those of the
motion itself. There it looks like a torque that couples the joints. Both are linear in the references, so that the
answer is known from gains and inertia, and can be taken from the positions.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identification.data.checks.readings.plausible_fit import unexplained
from identification.data.checks.readings.reading import Reading
from identification.data.recording import Recording
from identification.data.signals import holds_references, process
from identification.notes import Code, Note
from phantom_dyn.array_types import Array, Float, read_only
from phantom_dyn.dynamics.dynamics import mass_matrix
from phantom_dyn.errors import ChainError, LogError
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion

# Multiples of the sampling frequency, of either sign, at which the steps of a reference have their content.
_IMAGES = 3
# Rows by which references are continued at both ends.
_PADDING = 200
# Largest spread of the times between rows, relative to their median, with which rows are even.
_EVEN = 0.05
# Postures over which the inertia is averaged.
_POSTURES = 50
# Mean gain of a reading over all joints and both halves, as the logarithm of unexplained amplitudes, from which on it
# is seen in the log; and the largest loss of one of them.
_SEEN, _LOSS = 0.3, 0.2
# Delays besides half a row, as shares of a row, which must explain the log less well than held references do.
_OTHER_DELAYS = (0.25, 0.75)
# Time between rows [s] below which half of it is no more than a drive's own lateness, and steps move no joint.
_SHORT = 0.004
# Largest number of joints: for more the comparison would take longer than a diagnosis.
_MOST_JOINTS = 12


def with_held_references(robot: Robot, recording: Recording) -> Recording:
    """The recording with references that are held if it shows that, and without the answer to their steps.

    Args:
        robot: The given model; how it says that references act is not questioned.
        recording: Its torque is that of the controllers.

    Returns:
        The recording, with a note if the holding was seen and not stated. The answer to steps is taken from the
        positions only where less is left unexplained without it, as it depends on the inertia of the model.
    """
    gain, q_ref = recording.follows, recording.q_ref
    if gain is None or q_ref is None or not gain.any() or robot.nv > _MOST_JOINTS or not _has_slow_even_rows(recording):
        return recording
    held = holds_references(recording, robot)
    if not held and (robot.reference_hold is not None or robot.torque_hold == "zoh"):
        return recording
    try:
        if held:
            return _better_without_answer(robot, recording)
        at_once = left_by(robot, recording)
        as_held = _better_without_answer(robot, replace(recording, references_held=True))
        gains = np.log(at_once / left_by(robot, as_held))
        late = [np.mean(np.log(at_once / left_by(robot, _delayed(recording, part)))) for part in _OTHER_DELAYS]
    except (ChainError, LogError):
        return recording
    if not gains.mean() > max(_SEEN, *late) or gains.min() < -_LOSS:
        return recording
    row = float(np.median(np.diff(recording.t)))
    note = Note(Code.HELD_SEEN, numbers={"file": recording.file, "row": row})
    return replace(as_held, notes=(*recording.notes, note))


def _has_slow_even_rows(recording: Recording) -> bool:
    """True if rows come at even times, and seldom enough for steps to matter."""
    steps = np.diff(recording.t)
    return bool(np.std(steps) < _EVEN * np.median(steps) and np.median(steps) >= _SHORT)


def _better_without_answer(robot: Robot, recording: Recording) -> Recording:
    """The recording without the answer to steps of its references, if that leaves less unexplained."""
    smooth = without_answer(robot, recording)
    gains = np.log(left_by(robot, recording) / left_by(robot, smooth))
    return smooth if gains.mean() > 0 and gains.min() > -_LOSS else recording


def left_by(robot: Robot, recording: Recording) -> Float[Array, "2 nv"]:
    """Torque that no plausible robot explains in each half of a recording, root mean square [N m or N]."""
    log = process(recording, robot)
    motion, band = log.motion, log.band
    rows = Motion(motion.t[log.samples], band(motion.q), band(motion.v), band(motion.a))
    tau = band(log.tau)
    left = unexplained(robot, Reading(rows, band(np.sign(motion.v)), tau, np.zeros_like(tau)))
    half = len(tau) // 2
    size = np.array([tau[:half].var(axis=0), tau[half:].var(axis=0)])
    # A half in which a torque hardly varies says nothing, and the same in every reading.
    return np.where(np.isnan(left), 1.0, np.sqrt(np.maximum(left, 1e-12) * np.maximum(size, 1e-300)))


def _delayed(recording: Recording, part: float) -> Recording:
    """The recording with references, and the torque that follows them, later by a part of a row."""
    assert recording.q_ref is not None
    assert recording.tau is not None
    assert recording.follows is not None
    q_ref = (1 - part) * recording.q_ref + part * np.vstack([recording.q_ref[:1], recording.q_ref[:-1]])
    tau = recording.tau + recording.follows * (q_ref - recording.q_ref)
    return replace(recording, q_ref=read_only(q_ref), tau=read_only(tau))


def without_answer(robot: Robot, recording: Recording) -> Recording:
    """The recording with positions, and torques, as they were if references moved on smoothly with the same mean."""
    assert recording.q_ref is not None
    assert recording.tau is not None
    assert recording.follows is not None
    t = recording.t
    kd = np.zeros(robot.nv) if recording.slowing is None else recording.slowing
    postures = recording.q[:: max(len(t) // _POSTURES, 1)]
    mobility = np.linalg.inv(mass_matrix(robot, postures)).mean(axis=0)
    step = float(np.median(np.diff(t)))
    answer = answer_to_steps(np.linalg.inv(mobility), recording.follows, kd, step, recording.q_ref)
    tau = recording.tau + recording.follows * answer + kd * np.gradient(answer, t, axis=0)
    return replace(recording, q=read_only(recording.q - answer), tau=read_only(tau))


def answer_to_steps(
    M: Float[Array, "nv nv"], kp: Float[Array, " nv"], kd: Float[Array, " nv"], step: float, q_ref: Float[Array, "N nv"]
) -> Float[Array, "N nv"]:
    """How far joints are, when a row is read, from where references without steps would have them [rad or m].

    A reference ``u`` that is held for ``T`` has the spectrum of ``u`` times ``sinc(f T) exp(-i pi f T)`` at all
    frequencies ``f + m / T``. Those with ``m`` other than zero are its steps. Joints answer them by
    ``(M s^2 + kd s + kp)^-1 kp``, and reading them once a row adds all answers at the frequency ``f``.

    Args:
        M: Inertia of the joints [kg m^2 or kg].
        kp: Gains of the controllers [N m/rad or N/m].
        kd: Their damping [N m s/rad or N s/m].
        step: Time ``T`` between rows, for which each reference is held [s].
        q_ref: References [rad or m].
    """
    pad = min(len(q_ref) - 1, _PADDING)
    before, after = 2 * q_ref[0] - q_ref[pad:0:-1], 2 * q_ref[-1] - q_ref[-2 : -pad - 2 : -1]
    # Without a jump from the end to the start, as a spectrum is that of a periodic signal.
    rise = np.sin(0.5 * np.pi * np.arange(pad) / pad)[:, None] ** 2
    middle = q_ref.mean(axis=0)
    padded = np.concatenate([rise * (before - middle), q_ref - middle, rise[::-1] * (after - middle)])
    spectrum, frequencies = np.fft.rfft(padded, axis=0), np.fft.rfftfreq(len(padded), step)
    out = np.zeros_like(spectrum)
    for m in (m for m in range(-_IMAGES, _IMAGES + 1) if m):
        f = frequencies + m / step
        s = 2j * np.pi * f[:, None, None]
        driven = kp * spectrum * (np.sinc(f * step) * np.exp(-1j * np.pi * f * step))[:, None]
        out += np.linalg.solve(M * s**2 + np.diag(kd) * s + np.diag(kp), driven[:, :, None])[:, :, 0]
    return np.fft.irfft(out, len(padded), axis=0)[pad : pad + len(q_ref)]
