"""Which simpler answers a recording cannot part from the truth, with the model free within its tolerance."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.optimize import least_squares, lsq_linear

from benchmarks.blind.generator.effects import Effect
from benchmarks.blind.generator.plant import rigid_torque, with_point_mass
from benchmarks.blind.generator.robots import Table
from benchmarks.blind.generator.sizing import Ruler, banded, rms

# Noise floors: over 18 s below 20 Hz, some 700 independent samples, less than this is no significant misfit (chi
# square of 7 or less).
ALIKE = 0.1
PARAMETERS = {
    "viscous_friction": 1,
    "coulomb_friction": 1,
    "torque_offset": 1,
    "rotor_inertia": 1,
    "torque_constant": 1,
    "parasitic_spring": 2,
    "stribeck_friction": 3,
    "direction_dependent_friction": 4,
    "payload": 4,
    "inertial_parameters": 4,
}
STRIBECK_SPEEDS = (0.03, 0.05, 0.08, 0.12, 0.2, 0.3)


def _columns(measure: Ruler, j: int) -> Iterator[tuple[str, np.ndarray, float]]:
    """Name, torque of joint ``j`` per unit of each coefficient ``(n, k)``, and the coefficients' lower bound."""
    q, v, a, tau = (x[:, j] for x in measure.full)
    sign = np.tanh(v / 1e-3)

    def band(*columns: np.ndarray) -> np.ndarray:
        return banded(np.stack(columns, axis=1), measure.rate)

    yield "viscous_friction", band(v), 0.0
    yield "coulomb_friction", band(sign), 0.0
    yield "torque_offset", band(np.ones_like(v)), -np.inf
    yield "rotor_inertia", band(a), 0.0
    yield "torque_constant", band(tau), -np.inf
    yield "parasitic_spring", band(q, np.ones_like(q)), -np.inf
    up, down = 0.5 * (1.0 + sign), 0.5 * (1.0 - sign)
    yield "direction_dependent_friction", band(up, -down, v * up, v * down), -np.inf
    for speed in STRIBECK_SPEEDS:
        yield "stribeck_friction", band(sign, sign * np.exp(-((v / speed) ** 2))), 0.0


def _misfit(measure: Ruler, change: np.ndarray, columns: np.ndarray, lower: float) -> float:
    """What the best coefficients and the best moves within the tolerance leave, root of the sum of squares."""
    basis, triangle = measure.nuisance
    both = np.hstack([columns, basis @ triangle]) if triangle.size else columns
    q, r = np.linalg.qr(both)
    seen, k = q.T @ change, columns.shape[1]
    low = np.concatenate([np.full(k, lower), -2.0 - measure.place - 1e-9])
    high = np.concatenate([np.full(k, np.inf), 2.0 - measure.place + 1e-9])
    fit = lsq_linear(r, seen, bounds=(low, high))
    return float(np.sqrt(max(change @ change - seen @ seen, 0.0) + 2.0 * fit.cost))


def _payload_misfit(measure: Ruler, change: np.ndarray, length: float) -> float:
    """The same for a point mass on the last link at the best place, within twice the reach of that link."""
    truth, thin = measure.truth, measure.thin
    base = rigid_torque(truth, *thin)

    def torque(mass: float, center: np.ndarray) -> np.ndarray:
        last = with_point_mass(truth.links[-1], mass, center)
        links = Table(truth.name, (*truth.links[:-1], last))
        return ((rigid_torque(links, *thin) - base) / measure.floor).reshape(-1)

    # The torque is linear in m, m c and m (c_i c_j): ten columns from ten point masses, then only algebra.
    places = length * np.array([[i, j, k] for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1)], dtype=float)
    basis, triangle = measure.nuisance
    columns = np.linalg.lstsq(np.array([_moments(p) for p in places]), np.array([torque(1.0, p) for p in places]))[0].T
    q, r = np.linalg.qr(np.hstack([columns, basis @ triangle]) if triangle.size else columns)
    seen = q.T @ change
    scale = measure.truth.links[-1].mass

    def residual(x: np.ndarray) -> np.ndarray:
        return r @ np.concatenate([x[0] * scale * _moments(length * x[1:4]), x[4:]]) - seen

    place = measure.place
    low = np.concatenate([[0.0, -2.0, -2.0, -2.0], -2.0 - place - 1e-9])
    high = np.concatenate([[10.0, 2.0, 2.0, 2.0], 2.0 - place + 1e-9])
    start = np.concatenate([[0.1], np.asarray(truth.links[-1].center) / length, np.zeros(len(place))])
    fit = least_squares(residual, np.clip(start, low + 1e-6, high - 1e-6), bounds=(low, high), max_nfev=100)
    return float(np.sqrt(max(change @ change - seen @ seen, 0.0) + 2.0 * fit.cost))


def _moments(c: np.ndarray) -> np.ndarray:
    """What the torque of a unit point mass at ``c`` is linear in."""
    x, y, z = c
    return np.array([1.0, x, y, z, x * x, y * y, z * z, x * y, x * z, y * z])


def alike(effect: Effect, measure: Ruler) -> list[dict]:
    """Answers with no more parameters than the truth that leave less than `ALIKE`: effect, joint, what they leave.

    An answer with more parameters that holds the truth as a special case is not among them: the data part them as far
    as the simpler one is enough.
    """
    change = measure.change(effect)
    reached, flat = max(1, int(np.sum(rms(change) > 1e-6))), change.reshape(-1)
    unit = np.sqrt(len(change) * reached)
    best: dict[tuple[str, str | None], float] = {}
    for j, name in enumerate(measure.truth.joints):
        for rival, torque, lower in _columns(measure, j):
            if PARAMETERS[rival] > PARAMETERS[effect.effect] or (rival, j) == (effect.effect, effect.joint):
                continue
            columns = np.zeros((*change.shape, torque.shape[1]))
            columns[:, j] = torque / measure.floor[j]
            left = _misfit(measure, flat, columns.reshape(len(flat), -1), lower) / unit
            best[rival, name] = min(left, best.get((rival, name), np.inf))
    if effect.effect == "inertial_parameters":
        reach = float(np.linalg.norm(measure.truth.links[-1].center)) * 2.0
        best["payload", None] = _payload_misfit(measure, flat, reach) / unit
    return [{"effect": e, "joint": j, "leaves": float(left)} for (e, j), left in best.items() if left < ALIKE]
