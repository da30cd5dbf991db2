"""What a fit says of held-out samples: torques in the band, and spectra at the full rate."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from jaxtyping import Float

from identification.diagnosis.thinning import gap_starts
from identification.estimators.fit import Fit
from identification.identify.result import Evidence
from identification.log import Log
from identification.regressor import Regressor
from phantom_dyn.dynamics import inverse_dynamics
from phantom_dyn.robot import Robot

Array = np.ndarray

_BETWEEN = 20  # steps between two recordings on the axis of time
_LONGEST = 1024  # samples of a piece of the spectrum
_SHORTEST = 64


def held_out_evidence(given: Robot, fitted: Robot, fit: Fit, logs: tuple[Log, ...]) -> Evidence:
    """Torques and spectra on logs that the fit has not seen.

    Args:
        given: The robot as its file states it.
        fitted: The robot that was fitted, without what was an unknown.
        fit: Of it.
        logs: With at least one valid sample in the band.
    """
    times, torques, pieces = [], [], []
    start = 0.0
    for log in logs:
        whole = [log.tau, fit.predict(fitted, log.motion), inverse_dynamics(given, log.motion)]
        torques.append([Regressor.in_band(log, values) for values in whole])
        t = log.motion.t[log.samples][log.valid_in_band]
        # One recording keeps its own time; others follow behind a gap.
        shift = start - t[0] if times and len(t) else 0.0
        times.append(t + shift)
        if len(t):
            start = float(t[-1] + shift) + _BETWEEN * log.band.step / log.band.rate_hz
        pieces += _stretches(log, whole[0], whole[0] - whole[1])
    measured, predicted, model = (np.concatenate([torque[k] for torque in torques]) for k in range(3))
    return Evidence(np.concatenate(times), measured, predicted, model, *_densities(pieces))


def _stretches(log: Log, measured: Array, residual: Array) -> list[tuple[float, Array]]:
    """Rate and both signals side by side, shape ``(n, 2 nv)``, of every stretch of valid samples."""
    t = log.motion.t[log.valid]
    both = np.hstack([measured, residual])[log.valid]
    return [(log.band.rate_hz, both[a:b]) for a, b in pairwise([0, *gap_starts(t).tolist(), len(t)])]


def _densities(
    pieces: list[tuple[float, Array]],
) -> tuple[Float[Array, " F"], Float[Array, "F nv"], Float[Array, "F nv"]]:
    """Amplitude densities of all stretches that are as long as the longest allows, weighted by their length."""
    from scipy.signal import welch

    nv = pieces[0][1].shape[1] // 2
    longest = max(len(piece) for _, piece in pieces)
    length = min(_LONGEST, longest // 2 if longest >= 2 * _SHORTEST else longest)
    if length < _SHORTEST:
        return np.zeros(0), np.zeros((0, nv)), np.zeros((0, nv))
    rate = pieces[int(np.argmax([len(piece) for _, piece in pieces]))][0]
    power, weight, f = 0.0, 0, np.zeros(0)
    for its_rate, piece in pieces:
        # Recordings of another rate have other frequencies.
        if len(piece) >= length and abs(its_rate - rate) < 1e-3 * rate:
            f, density = welch(piece, rate, nperseg=length, axis=0, detrend="constant")
            power, weight = power + len(piece) * density, weight + len(piece)
    amplitude = np.sqrt(power / weight)[1:]  # without the mean
    return f[1:], amplitude[:, :nv], amplitude[:, nv:]
