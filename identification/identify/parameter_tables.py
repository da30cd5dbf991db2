"""A fit as rows of a table, and what it says of held-out samples.

A fit as rows of a table: value, deviation, what it is the sum of, and whether it differs from zero.

What a fit says of held-out samples: torques in the band, and spectra at the full rate.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from jaxtyping import Float

from identification.data.log import Log
from identification.estimators.fit import Fit
from identification.identify.identification import Evidence, JointError, Parameter
from identification.regression.regressor import Regressor
from identification.reporting.thinning import gap_starts
from identification.words.numbers import number
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.model.robot import Robot

Array = np.ndarray

SURE = 2.0
"""So many standard deviations from zero a value is called identified: about 95 % of values that are zero are not."""


def parameters(fit: Fit) -> tuple[tuple[Parameter, ...], tuple[Parameter, ...]]:
    """Base parameters of the links, and those of friction and drives.

    Args:
        fit: The fit.
    """
    sums = dict(equation.split(" = ", 1) for equation in fit.base.regroupings())
    owners = _owners(fit)
    links: list[Parameter] = []
    others: list[Parameter] = []
    for row, k in enumerate(fit.base.independent):
        value, std, unit = float(fit.theta[row]), float(fit.std()[row]), fit.units[row]
        sure = bool(abs(value) > SURE * std)
        joint, effect = owners.get(fit.base.names[k], (None, None))
        parameter = Parameter(
            name=fit.names[row],
            value=value,
            std=std,
            unit=unit,
            regroups=sums.get(fit.names[row], ""),
            identified=sure,
            why="" if sure else _why(value, std, unit),
            joint=joint,
            effect=effect,
        )
        (links if k < fit.first_effect else others).append(parameter)
    return tuple(links), tuple(others)


def joint_errors(
    robot: Robot,
    measured: Float[Array, "N nv"],
    predicted: Float[Array, "N nv"],
    given: Float[Array, "N nv"],
    fitted: Float[Array, " nv"],
) -> tuple[JointError, ...]:
    """Errors of every joint on held-out samples.

    Args:
        robot: Gives names and units.
        measured: Torque in the band.
        predicted: By the fit.
        given: By the given model.
        fitted: Relative error [%] on the samples of the fit.
    """
    size = np.sqrt(np.mean(measured**2, axis=0))
    rms, before = (np.sqrt(np.mean((measured - model) ** 2, axis=0)) for model in (predicted, given))
    relative, relative_given = (_over(values, size) for values in (rms, before))
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


def _over(values: Array, size: Array) -> Array:
    out = np.full(len(values), np.nan)
    return np.divide(values, size, out=out, where=size > 0)


def _owners(fit: Fit) -> dict[str, tuple[str | None, str]]:
    """Joint and effect of each effect's column."""
    out: dict[str, tuple[str | None, str]] = {}
    for name in fit.base.names[fit.first_effect :]:
        term = next(term for term in fit.effects if name.startswith(f"{term.label}."))
        out[name] = (term.joint, term.effect.name)
    return out


def _why(value: float, std: float, unit: str) -> str:
    if not np.isfinite(std):
        return "no more equations than unknowns, so its deviation is not known"
    return f"not told from zero: its size is below {number(abs(value) + SURE * std)} {unit} (95 %)"


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
