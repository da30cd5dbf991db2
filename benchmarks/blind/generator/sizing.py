"""How large an effect is: what it changes in the drive torque, in units of the noise floor of its recording."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import lsq_linear
from scipy.signal import butter, sosfiltfilt

from benchmarks.blind.generator.effects import INERTIAL, Effect, Recipe, largest_magnitude, needed_torque, realised
from benchmarks.blind.generator.plant import mass_matrix, rigid_torque
from benchmarks.blind.generator.robots import Link, Table, Tolerance
from benchmarks.blind.generator.simulate import Run, Session, midpoint_motion

BAND = 20.0  # [Hz]: all sizes are stated in this band
CROP = 0.5  # [s]: left out at both ends, where the filter has no past or no future
SMALL = 0.01  # of a sigma: one moment of a thin rod moved further breaks the triangle inequality of inertias
SHARE_BEYOND, ENOUGH_BEYOND = 0.5, 2.0  # an effect: tolerance leaves half of it, or two noise floors


def banded(x: np.ndarray, rate: float) -> np.ndarray:
    """Zero-phase low pass at `BAND`, ends cropped, thinned to about 100 Hz."""
    smooth = sosfiltfilt(butter(4, BAND, fs=rate, output="sos"), x, axis=0)
    crop = round(CROP * rate)
    return smooth[crop : -crop : max(1, round(rate / 100.0))]


def rms(x: np.ndarray) -> np.ndarray:
    """Root mean square over samples, one per joint."""
    return np.sqrt(np.mean(np.square(x), axis=0))


def noise_floor(owner: Table, session: Session, run: Run) -> np.ndarray:
    """What the disturbance and the encoder leave in the drive torque within the band, ``(nv,)`` [N m]."""
    error = run.measured - run.q[:-1]
    acceleration = np.zeros_like(error)
    acceleration[1:-1] = (error[2:] - 2.0 * error[1:-1] + error[:-2]) * session.rate**2
    inertia = mass_matrix(owner, run.q[:: max(1, len(run.q) // 50)])
    return rms(banded(session.disturbance, session.rate) - banded(acceleration, session.rate) @ inertia)


def unexplained_torque(run: Run, truth: Table, session: Session) -> np.ndarray:
    """Logged torque plus disturbance less what the true links need: friction and effects, banded."""
    return banded(run.command + session.disturbance - rigid_torque(truth, *midpoint_motion(run)), session.rate)


def paired_gap(run: Run, pair: Run, truth: Table, session: Session, floor: np.ndarray) -> np.ndarray:
    """Measured difference between a run and its pair without the effect, in noise floors, ``(nv,)``."""
    return rms(unexplained_torque(run, truth, session) - unexplained_torque(pair, truth, session)) / floor


@dataclass(frozen=True)
class Ruler:
    """What is needed to size an effect without simulating it: the motion of the run without it.

    Attributes:
        truth: True robot.
        rate: [Hz].
        full: q, v, a, logged torque at every sample.
        thin: q, v, a in the band at the thinned samples.
        floor: Noise floor, ``(nv,)`` [N m].
        nuisance: What one sigma of every modelled quantity changes, in noise floors, ``(n nv, p)``, as Q and R.
        place: True place of these quantities in sigmas, ``(p,)``.
    """

    truth: Table
    rate: float
    full: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
    thin: tuple[np.ndarray, np.ndarray, np.ndarray]
    floor: np.ndarray
    nuisance: tuple[np.ndarray, np.ndarray]
    place: np.ndarray

    def change(self, effect: Effect) -> np.ndarray:
        """Change of the drive torque in noise floors along the run, ``(n, nv)``."""
        if effect.effect in INERTIAL:
            return needed_torque(effect, self.truth, *self.thin, tau=np.empty(0)) / self.floor
        return banded(needed_torque(effect, self.truth, *self.full), self.rate) / self.floor

    def size(self, effect: Effect) -> float:
        """Root mean square of the change over time and over the joints that it reaches, in noise floors."""
        return over_reached(rms(self.change(effect)))

    def beyond_tolerance(self, effect: Effect) -> float:
        """The size that is left when the model may move within two tolerances to explain it."""
        change = self.change(effect)
        reached = max(1, int(np.sum(rms(change) > 1e-6)))
        flat = change.reshape(-1)
        q, r = self.nuisance
        left = float(flat @ flat)
        if r.size:
            seen = q.T @ flat
            fit = lsq_linear(r, seen, bounds=(-2.0 - self.place - 1e-9, 2.0 - self.place + 1e-9))
            left = max(left - float(seen @ seen), 0.0) + 2.0 * fit.cost
        return float(np.sqrt(left / len(change) / reached))


def over_reached(per_joint: np.ndarray) -> float:
    """Root mean square over the joints that an effect reaches."""
    reached = per_joint[per_joint > 1e-6]
    return float(np.sqrt(np.mean(reached**2))) if len(reached) else 0.0


def _moves(tolerance: Tolerance) -> list[tuple[float, Callable[[Link, float], Link], Callable[[Link], float]]]:
    """Sigma, relative move and value of every modelled quantity of a link."""

    def component(name: str, i: int) -> Callable[[Link, float], Link]:
        def move(link: Link, by: float) -> Link:
            values = list(getattr(link, name))
            values[i] *= 1.0 + by
            return replace(link, **{name: tuple(values)})

        return move

    def scalar(name: str) -> Callable[[Link, float], Link]:
        return lambda link, by: replace(link, **{name: getattr(link, name) * (1.0 + by)})

    out = [(tolerance.inertia, scalar("mass"), lambda link: link.mass)]
    for i in range(3):
        out.append((tolerance.inertia, component("center", i), lambda link, i=i: link.center[i]))
        out.append((tolerance.inertia, component("inertia", i), lambda link, i=i: link.inertia[i]))
    return [*out, (tolerance.rotor_inertia, scalar("rotor_inertia"), lambda link: link.rotor_inertia)]


def _nuisance(
    owner: Table, truth: Table, tolerance: Tolerance, thin: tuple, friction: np.ndarray, floor: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Columns of one sigma each, ``(n nv, p)`` in noise floors, and where the truth lies, ``(p,)`` in sigmas."""
    base, columns, places = rigid_torque(owner, *thin), [], []
    for j, (mine, true) in enumerate(zip(owner.links, truth.links, strict=True)):
        for sigma, move, value in _moves(tolerance):
            if sigma == 0.0 or value(mine) == 0.0:
                continue
            links = (*owner.links[:j], move(mine, SMALL * sigma), *owner.links[j + 1 :])
            columns.append((rigid_torque(Table(owner.name, links), *thin) - base) / (SMALL * floor))
            places.append((value(true) / value(mine) - 1.0) / sigma)
        for part, name in enumerate(("viscous", "coulomb")):
            if tolerance.friction == 0.0 or getattr(mine, name) == 0.0:
                continue
            column = np.zeros_like(base)
            column[:, j] = tolerance.friction * getattr(mine, name) * friction[part, :, j] / floor[j]
            columns.append(column)
            places.append((getattr(true, name) / getattr(mine, name) - 1.0) / tolerance.friction)
    if not columns:
        return np.empty((base.size, 0)), np.empty(0)
    return np.stack([c.reshape(-1) for c in columns], axis=1), np.array(places)


def ruler(owner: Table, truth: Table, tolerance: Tolerance, session: Session, run: Run) -> Ruler:
    """Measures the run without the effect once, so that every magnitude can be sized from it."""
    q, v, a = midpoint_motion(run)
    thin = (banded(q, session.rate), banded(v, session.rate), banded(a, session.rate))
    friction = np.stack([thin[1], banded(np.tanh(v / 1e-3), session.rate)])
    floor = noise_floor(owner, session, run)
    columns, place = _nuisance(owner, truth, tolerance, thin, friction, floor)
    basis, triangle = np.linalg.qr(columns) if columns.size else (columns, columns[:0])
    return Ruler(truth, session.rate, (q, v, a, run.command), thin, floor, (basis, triangle), place)


def sized(recipe: Recipe, measure: Ruler, size: float) -> Effect | None:
    """The effect at the wanted size, or larger where tolerance could explain too much of it; None if it cannot be."""
    largest, m = largest_magnitude(recipe), 0.05
    for _ in range(8):
        reached = measure.size(realised(recipe, m))
        if reached <= 0.0:
            return None
        m = min(m * min(max(size / reached, 1e-3), 1e3), largest)
    while m <= largest:
        effect = realised(recipe, m)
        if measure.beyond_tolerance(effect) >= min(SHARE_BEYOND * measure.size(effect), ENOUGH_BEYOND):
            return effect
        m *= 1.15
    return None
