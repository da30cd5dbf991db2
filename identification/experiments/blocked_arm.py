"""Hysteresis loops of blocked arms from recordings: one joint whose motor turns against links that are held."""

from __future__ import annotations

import numpy as np

from identification.data.recording import Recording
from identification.data.signals import uniform
from identification.experiments.transmission import Loop
from phantom_dyn.errors import LogError

_HARMONICS = 20.0  # of the triangle that are kept: its corners lie above
_SHARE_OF_RATE = 0.2


def loop_of(recording: Recording, joint: str) -> Loop:
    """Torque and motor position of one joint of a recording.

    Raises:
        LogError: If the recording has no torque, or is not usable for the loop.
    """
    t, q, tau, valid = uniform(recording)
    if not valid.all():
        raise LogError(f"{recording.file} has gaps: record the loop in one piece, or cut the file at them.")
    k = recording.joint_names.index(joint)
    return Loop(t, tau[:, k], q[:, k])


def cutoff_of(loops: tuple[Loop, ...]) -> float:
    """Frequency [Hz] up to which positions are kept: twenty times that of the slowest torque, where the rate allows."""
    edges = []
    for loop in loops:
        rate = (len(loop.t) - 1) / (loop.t[-1] - loop.t[0])
        power = np.abs(np.fft.rfft(loop.torque - loop.torque.mean())) ** 2
        main = float(np.argmax(power)) * rate / len(loop.t)
        edges.append(min(_HARMONICS * max(main, 1.0 / (loop.t[-1] - loop.t[0])), _SHARE_OF_RATE * rate))
    return max(edges)


def moving_joint(recordings: tuple[Recording, ...]) -> str:
    """The joint whose torque changes most in all recordings: the one whose motor pushed.

    Raises:
        LogError: If a recording has no torque, or in none a torque changes.
    """
    swing = np.zeros(len(recordings[0].joint_names))
    for recording in recordings:
        if recording.tau is None:
            raise LogError(f"{recording.file} has no torque: record the motor's torque, or its current with a map.")
        swing += recording.tau.std(axis=0)
    if not swing.max() > 0:
        raise LogError(f"{recordings[0].file}: no torque changes; let one motor push and pull against the held arm.")
    return recordings[0].joint_names[int(np.argmax(swing))]
