"""Finds torques that were low-passed before they were recorded, although the positions were not."""

from __future__ import annotations

import numpy as np

from identification.data.recording import Recording
from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import listed
from phantom_dyn.signals.spectra import power_density

# Two frequency bands, as shares of the sample rate, in which no robot moves. White sensor noise has the same power
# density in both; after a low pass it has far less in the upper one.
_LOWER, _UPPER = (0.12, 0.25), (0.35, 0.48)
# A torque was filtered if its power density in the upper band, relative to the lower one, is below the first number
# [dB]. A position was not filtered if the same ratio is above the second number. A torque that is averaged over each
# sample has -10 dB, and recorded torques without a filter have -16 dB or more. After a second-order low pass at a
# twentieth of the sample rate a torque has -25 dB or less.
_FILTERED, _UNFILTERED = -20.0, -12.0
# Smallest difference [dB] of this ratio between position and torque that shows different filters.
_DIFFERENCE = 15.0
_FEWEST = 500  # smallest number of samples


def roll_off(x: Float[Array, "N k"]) -> Float[Array, " k"]:
    """Power density in the band `_UPPER` relative to the band `_LOWER` [dB]; 0 for white noise.

    Args:
        x: Samples at a uniform rate, one signal in each column.
    """
    if not x.shape[1]:
        return np.zeros(0)
    # The spectrum is that of the differences of x, divided by the gain of a difference: so the large power of the
    # motion at low frequencies does not leak into the bands.
    differences, length = np.diff(x, axis=0), min(512, len(x) // 4)
    f, power = power_density(differences, 1.0, length, window="blackmanharris", linear=True)
    power = power / np.maximum((2 * np.sin(np.pi * f)) ** 2, 1e-12)[:, None]
    lower, upper = (np.median(power[(f >= a) & (f <= b)], axis=0) for a, b in (_LOWER, _UPPER))
    return 10 * np.log10(np.maximum(upper, 1e-300) / np.maximum(lower, 1e-300))


def filtered_joints(recording: Recording) -> tuple[str, ...]:
    """Names of joints whose torque went through a low pass of at least second order, and whose position did not."""
    if recording.tau is None or len(recording.t) < _FEWEST:
        return ()
    moves = np.flatnonzero((np.ptp(recording.q, axis=0) > 0) & (np.ptp(recording.tau, axis=0) > 0))
    of_torque = roll_off(recording.tau[:, moves])
    suspect, of_torque = moves[of_torque < _FILTERED], of_torque[of_torque < _FILTERED]
    of_position = roll_off(recording.q[:, suspect])
    filtered = suspect[(of_position > _UNFILTERED) & (of_position - of_torque > _DIFFERENCE)]
    return tuple(recording.joint_names[joint] for joint in filtered)


def check_filtered(recording: Recording, filtered: tuple[str, ...]) -> tuple[str, ...]:
    """A warning on torques that were filtered although the positions were not.

    Args:
        recording: Raw samples.
        filtered: Result of `filtered_joints`.
    """
    if not filtered:
        return ()
    which = "torque" if len(filtered) == 1 else "torques"
    return (
        f"{recording.file}: the {which} of {listed(filtered)} went through a low-pass that the positions did not go "
        "through: the noise above the band cannot be used, and the filter's delay shows as one of the drive; record "
        "torques and positions through the same filter, or neither through one.",
    )
