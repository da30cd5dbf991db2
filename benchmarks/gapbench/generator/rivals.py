"""Simpler answers that a recording cannot distinguish from the truth, with the model free within its tolerance."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.optimize import least_squares, lsq_linear
from scipy.signal import lfilter

from .effects import WHOLE, Effect, changed_table, joint_name
from .guess import unit_change
from .inverse import rigid_torque
from .plant import with_point_mass
from .recipes import Recipe, payload_link
from .sizing import Ruler, at_samples, banded, reached

# Noise floors: over 12 s below 20 Hz, some 500 independent samples, less than this is no significant misfit (chi
# square of 5 or less).
ALIKE = 0.1
MOST_OF_ITS_OWN = 0.5  # of an effect: where its first order leaves more, it says nothing about rivals
PARAMETERS = {
    "stribeck_friction": 3,
    "direction_dependent_friction": 4,
    "presliding_friction": 2,
    "joint_coupling": 4,
    "cogging": 3,
    "payload": 4,
    "inertial_parameters": 4,
    "base_tilt": 2,
    "parasitic_spring": 2,
    "encoder_eccentricity": 2,
}  # of the others: one
STRIBECK_SPEEDS = (0.03, 0.05, 0.08, 0.12, 0.2, 0.3)
DISPLACEMENTS = (0.003, 0.006, 0.012, 0.025, 0.05)
TIMES = (0.7, 0.85, 1.0, 1.2, 1.4)  # of the true delay or lag
ONE_COLUMN = (
    "viscous_friction",
    "coulomb_friction",
    "torque_offset",
    "rotor_inertia",
    "torque_constant",
    "load_dependent_friction",
    "transmission_compliance",
    "encoder_offset",
)
AT_LEAST_ZERO = (*ONE_COLUMN[:2], "rotor_inertia", "load_dependent_friction", "transmission_compliance")
Rival = tuple[str, str | None, np.ndarray, float]


def _bristle(q: np.ndarray, displacement: float) -> np.ndarray:
    """Torque of a Dahl bristle of unit level along positions ``(n,)``."""
    out, state = np.empty_like(q), 0.0
    keep = np.exp(-np.abs(np.diff(q, prepend=q[0])) / displacement)
    goal = np.sign(np.diff(q, prepend=q[0]))
    for k in range(len(q)):
        state = goal[k] + (state - goal[k]) * keep[k]
        out[k] = state
    return out


def _late(measure: Ruler, effect: Effect, joint: int) -> Iterator[Rival]:
    """Delays and lags near the true time, second order included."""
    rate, tau = measure.session.rate, at_samples(measure.run.command)
    time = next(iter(effect.parameters.values()))
    here = np.ones(tau.shape[1]) if joint == WHOLE else np.arange(tau.shape[1]) == measure.truth.active.index(joint)
    t = np.arange(len(tau)) / rate
    label = None if joint == WHOLE else measure.truth.links[joint].joint
    for factor in TIMES:
        moved = np.stack([np.interp(t - factor * time, t, x) for x in tau.T], axis=1)
        yield "input_delay", label, banded(tau - moved, rate) * here / measure.floor, 0.0
        keep = np.exp(-1.0 / (rate * factor * time))
        slow = lfilter([1.0 - keep], [1.0, -keep], tau - tau[0], axis=0) + tau[0]
        yield "actuator_lag", label, banded(tau - slow, rate) * here / measure.floor, 0.0


def _rivals(effect: Effect, measure: Ruler) -> Iterator[Rival]:
    """Name, joint, torque per coefficient ``(n, nv)`` or ``(n, nv, k)``, lower bound of the coefficients."""
    table, rate = measure.truth, measure.session.rate

    def column(name: str, i: int, **shape: float) -> np.ndarray:
        change = unit_change(Recipe(name, i, shape), measure)
        assert change is not None
        return change

    for i, link in enumerate(table.links):
        passive = i not in table.active
        for name in ONE_COLUMN[:2] if passive else ONE_COLUMN:
            yield name, link.joint, column(name, i), 0.0 if name in AT_LEAST_ZERO else -np.inf
        if passive:
            continue
        one = column("torque_offset", i)
        sign, speed = column("coulomb_friction", i), column("viscous_friction", i)
        yield "parasitic_spring", link.joint, np.stack([column("parasitic_spring", i, rest=0.0), one], -1), -np.inf
        waves = [column("encoder_eccentricity", i, phase=p) for p in (0.0, 0.5 * np.pi)]
        yield "encoder_eccentricity", link.joint, np.stack(waves, -1), -np.inf
        lean, side = np.abs(sign) * np.sign(one), np.abs(speed) * np.sign(one)
        yield "direction_dependent_friction", link.joint, np.stack([sign, lean, speed, side], -1), -np.inf
        for s in STRIBECK_SPEEDS:
            fade = column("stribeck_friction", i, coulomb=0.0, speed=s)
            yield "stribeck_friction", link.joint, np.stack([sign, fade], -1), 0.0
        for d in DISPLACEMENTS:
            j = table.active.index(i)
            torque = np.zeros_like(measure.run.seen)
            torque[:, j] = _bristle(measure.run.seen[:, j], d)
            yield "presliding_friction", link.joint, banded(torque, rate) / measure.floor, 0.0
    across = [name for name, g in zip(("roll", "pitch", "yaw"), measure.truth.gravity, strict=True) if g == 0.0]
    angles = [column("base_tilt", WHOLE, **{name: 1.0}) for name in across]
    yield "base_tilt", None, np.stack(angles, -1), -np.inf
    if effect.effect in ("input_delay", "actuator_lag"):
        for joint in (WHOLE, *table.active):
            yield from _late(measure, effect, joint)
    else:
        for joint in (WHOLE, *table.active):
            label = None if joint == WHOLE else table.links[joint].joint
            for name in ("input_delay", "actuator_lag"):
                yield name, label, column(name, joint), 0.0


def _misfit(measure: Ruler, change: np.ndarray, columns: np.ndarray, lower: float, enough: float) -> float:
    """What the best coefficients and the best moves within the tolerance leave, root of the sum of squares.

    More than ``enough`` without any bound is not looked at further.
    """
    basis, triangle = measure.nuisance
    beside, own = np.linalg.qr(columns - basis @ (basis.T @ columns))
    # A column that the model's own moves make up adds no direction: it only goes further than they may.
    new = np.abs(np.diag(own)) > 1e-8 * np.linalg.norm(columns, axis=0)
    beside, own = beside[:, new], own[new]
    seen, more = basis.T @ change, beside.T @ change
    outside = max(float(change @ change - seen @ seen - more @ more), 0.0)
    if np.sqrt(outside) > enough:
        return float(np.sqrt(outside))
    r = np.block([[basis.T @ columns, triangle], [own, np.zeros((len(own), len(triangle)))]])
    low = np.concatenate([np.full(columns.shape[1], lower), -2.0 - measure.place - 1e-9])
    high = np.concatenate([np.full(columns.shape[1], np.inf), 2.0 - measure.place + 1e-9])
    fit = lsq_linear(r, np.concatenate([seen, more]), bounds=(low, high), tol=1e-6)
    return float(np.sqrt(outside + 2.0 * fit.cost))


def _moments(c: np.ndarray) -> np.ndarray:
    """What the torque of a unit point mass at ``c`` is linear in."""
    x, y, z = c
    return np.array([1.0, x, y, z, x * x, y * y, z * z, x * y, x * z, y * z])


def _payload_misfit(measure: Ruler, change: np.ndarray) -> float:
    """The same for a point mass on the last link at the best place, within twice the reach of that link."""
    truth, thin, last = measure.truth, measure.thin[:3], payload_link(measure.truth)
    link = truth.links[last]
    length = max(2.0 * float(np.linalg.norm(link.center)), 0.1)
    base = rigid_torque(truth, *thin)

    def torque(mass: float, center: np.ndarray) -> np.ndarray:
        loaded = truth.with_link(last, with_point_mass(link, mass, center))
        return ((rigid_torque(loaded, *thin) - base) / measure.floor).reshape(-1)

    # The torque is linear in m, m c and m (c_i c_j): ten columns from ten point masses, then only algebra.
    places = length * np.array([[i, j, k] for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1)], dtype=float)
    basis, triangle = measure.nuisance
    columns = np.linalg.lstsq(np.array([_moments(p) for p in places]), np.array([torque(1.0, p) for p in places]))[0].T
    q, r = np.linalg.qr(np.hstack([columns, basis @ triangle]) if triangle.size else columns)
    seen, place = q.T @ change, measure.place

    def residual(x: np.ndarray) -> np.ndarray:
        return r @ np.concatenate([x[0] * link.mass * _moments(length * x[1:4]), x[4:]]) - seen

    low = np.concatenate([[0.0, -2.0, -2.0, -2.0], -2.0 - place - 1e-9])
    high = np.concatenate([[10.0, 2.0, 2.0, 2.0], 2.0 - place + 1e-9])
    start = np.concatenate([[0.1], np.asarray(link.center) / length, np.zeros(len(place))])
    fit = least_squares(residual, np.clip(start, low + 1e-6, high - 1e-6), bounds=(low, high), max_nfev=100)
    return float(np.sqrt(max(change @ change - seen @ seen, 0.0) + 2.0 * fit.cost))


def _exact(effect: Effect, change: np.ndarray, measure: Ruler) -> np.ndarray:
    """The change without what the closed loop hands on, where the robot's own equations say it exactly."""
    if effect.effect not in ("payload", "inertial_parameters", "rotor_inertia", "base_tilt"):
        return change
    thin, truth = measure.thin[:3], measure.truth
    return (rigid_torque(changed_table(effect, truth), *thin) - rigid_torque(truth, *thin)) / measure.floor


def alike(effect: Effect, change: np.ndarray, measure: Ruler) -> list[dict]:
    """Answers with no more parameters than the truth that leave less than `ALIKE`: effect, joint, what they leave.

    What the truth's own first order leaves, where it has one, is taken off: both lack the same. An answer with more
    parameters that holds the truth as a special case is not among them: the data separate them as far as the simpler
    one is enough.

    Args:
        effect: The truth.
        change: Its paired difference, ``(n, nv)`` [noise floors].
        measure: Of the run without it.
    """
    change = _exact(effect, change, measure)
    unit = np.sqrt(len(change) * max(1, int(reached(change).sum())))
    flat, mine = change.reshape(-1), (effect.effect, joint_name(effect, measure.truth))
    size, rivals = float(np.linalg.norm(flat)) / unit, list(_rivals(effect, measure))

    def left(torque: np.ndarray, lower: float, enough: float) -> float:
        return _misfit(measure, flat, torque.reshape(len(flat), -1), lower, enough * unit) / unit

    own = min((left(torque, lower, np.inf) for *who, torque, lower in rivals if tuple(who) == mine), default=0.0)
    own = own if own < MOST_OF_ITS_OWN * size else 0.0
    best: dict[tuple[str, str | None], float] = {}
    for name, joint, torque, lower in rivals:
        if (name, joint) != mine and PARAMETERS.get(name, 1) <= PARAMETERS.get(effect.effect, 1):
            found = left(torque, lower, float(np.hypot(ALIKE, own)))
            best[name, joint] = min(found, best.get((name, joint), np.inf))
    if effect.effect == "inertial_parameters":
        best["payload", None] = _payload_misfit(measure, flat) / unit
    over = {who: float(np.sqrt(max(found**2 - own**2, 0.0))) for who, found in best.items()}
    return [{"effect": e, "joint": j, "leaves": found} for (e, j), found in over.items() if found < ALIKE]
