"""How large a change is: what it does to the drive torque that the motion seems to need, in noise floors."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import lsq_linear
from scipy.signal import butter, sosfiltfilt

from .inverse import mass_matrix, rigid_torque
from .robots import Link, Table, Tolerance
from .simulate import Run, Session

BAND = 20.0  # [Hz]: all sizes are stated in this band
CROP = 0.5  # [s]: left out at both ends, where the filter has no past or no future
SMALL = 1e-4  # of a sigma: an inertia near the edge of what is physical, moved further, is refused by the engine
REACHED = 0.1  # of the largest: a joint that an effect reaches; less is what the closed loop hands on
PRODUCTS = ((0, 1), (0, 2), (1, 2))  # axes of Ixy, Ixz, Iyz
SHARE_BEYOND, ENOUGH_BEYOND = 0.5, 2.0  # an effect: tolerance leaves half of it, or two noise floors


def low_passed(x: np.ndarray, rate: float) -> np.ndarray:
    """Zero-phase low pass at `BAND`."""
    return sosfiltfilt(butter(4, BAND, fs=rate, output="sos"), x, axis=0)


def thinned(x: np.ndarray, rate: float) -> np.ndarray:
    """Ends cropped, about 100 Hz."""
    crop = round(CROP * rate)
    return x[crop : -crop : max(1, round(rate / 100.0))]


def banded(x: np.ndarray, rate: float) -> np.ndarray:
    """Zero-phase low pass at `BAND`, ends cropped, thinned to about 100 Hz."""
    return thinned(low_passed(x, rate), rate)


def rms(x: np.ndarray) -> np.ndarray:
    """Root mean square over samples, one per joint."""
    return np.sqrt(np.mean(np.square(x), axis=0))


def at_samples(held: np.ndarray) -> np.ndarray:
    """A held torque at the samples: the mean of the holds on both sides, as a second difference sees it."""
    return 0.5 * (np.vstack([held[:1], held[:-1]]) + held)


def noise_floor(owner: Table, session: Session, run: Run) -> np.ndarray:
    """What the disturbance and the encoder leave in the drive torque within the band, ``(nv,)`` [N m]."""
    error = run.measured - run.seen
    acceleration = np.zeros_like(error)
    acceleration[1:-1] = (error[2:] - 2.0 * error[1:-1] + error[:-2]) * session.rate**2
    inertia = mass_matrix(owner, run.q[:: max(1, len(run.q) // 50)])
    return rms(banded(session.disturbance, session.rate) - banded(acceleration, session.rate) @ inertia)


def seen_motion(run: Run, rate: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Banded q, v, a at every sample, of what encoders without noise read."""
    q = low_passed(run.seen, rate)
    v, a = np.gradient(q, 1.0 / rate, axis=0), np.zeros_like(q)
    a[1:-1] = (q[2:] - 2.0 * q[1:-1] + q[:-2]) * rate**2
    return q, v, a


def unexplained_torque(run: Run, truth: Table, session: Session) -> np.ndarray:
    """Logged torque and disturbance less what the true robot needs for the motion that is seen, ``(n, nv)`` [N m]."""
    motion = seen_motion(run, session.rate)
    viscous, coulomb = (np.array([getattr(link, name) for link in truth.driven]) for name in ("viscous", "coulomb"))
    friction = viscous * motion[1] + coulomb * np.tanh(motion[1] / 5e-3)
    left = banded(at_samples(run.command + session.disturbance) - friction, session.rate)
    return left - rigid_torque(truth, *(thinned(x, session.rate) for x in motion))


def reached(change: np.ndarray) -> np.ndarray:
    """Which joints a change ``(n, nv)`` reaches."""
    size = rms(change)
    return size > max(REACHED * size.max(), 1e-9)


def size_of(change: np.ndarray) -> float:
    """Root mean square of a change over time and over the joints that it reaches."""
    return float(np.sqrt(np.mean(change[:, reached(change)] ** 2))) if reached(change).any() else 0.0


@dataclass(frozen=True)
class Ruler:
    """The run without anything wrong, and what is needed to measure other runs against it.

    Attributes:
        truth: True robot.
        session: Of all runs.
        run: Without anything wrong.
        thin: q, v, a, logged torque in the band at the thinned samples.
        floor: Noise floor, ``(nv,)`` [N m].
        nuisance: What one sigma of every modelled quantity changes, in noise floors, ``(n nv, p)``, as Q and R.
        place: True place of these quantities in sigmas, ``(p,)``.
    """

    truth: Table
    session: Session
    run: Run
    thin: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
    floor: np.ndarray
    base: np.ndarray
    nuisance: tuple[np.ndarray, np.ndarray]
    place: np.ndarray

    def change(self, run: Run) -> np.ndarray:
        """Paired difference to the run without anything wrong, in noise floors, ``(n, nv)``."""
        return (unexplained_torque(run, self.truth, self.session) - self.base) / self.floor

    def beyond_tolerance(self, change: np.ndarray) -> float:
        """The size that is left of a change when the model may move within two tolerances to explain it."""
        flat = change.reshape(-1)
        q, r = self.nuisance
        left = float(flat @ flat)
        if r.size:
            seen = q.T @ flat
            fit = lsq_linear(r, seen, bounds=(-2.0 - self.place - 1e-9, 2.0 - self.place + 1e-9), tol=1e-6)
            left = max(left - float(seen @ seen), 0.0) + 2.0 * fit.cost
        return float(np.sqrt(left / len(change) / max(1, int(reached(change).sum()))))


Move = tuple[float, Callable[[Link, float], Link], Callable[[Link, Link], float]]


def _scaled(name: str, sigma: float) -> Move:
    """The move of one number of a link, in parts of itself."""

    def move(link: Link, by: float) -> Link:
        return replace(link, **{name: getattr(link, name) * (1.0 + by)})

    def place(mine: Link, true: Link) -> float:
        return getattr(true, name) / getattr(mine, name) - 1.0 if getattr(mine, name) else 0.0

    return sigma, move, place


def _shifted(name: str, i: int, sigma: float) -> Move:
    """The move of one component of the centre (in parts of its distance) or inertia (of sqrt(Iaa Ibb))."""

    def unit(link: Link) -> float:
        if name == "center":
            return float(np.linalg.norm(link.center))
        a, b = PRODUCTS[i - 3] if i >= 3 else (i, i)
        return float(np.sqrt(link.inertia[a] * link.inertia[b]))

    def move(link: Link, by: float) -> Link:
        values = list(getattr(link, name))
        values[i] += unit(link) * by
        return replace(link, **{name: tuple(values)})

    def place(mine: Link, true: Link) -> float:
        return (getattr(true, name)[i] - getattr(mine, name)[i]) / unit(mine) if unit(mine) else 0.0

    return sigma, move, place


def _moves(tolerance: Tolerance) -> list[Move]:
    """Sigma, relative move of a link, and where the truth lies, of every modelled quantity of a link."""
    inertial = [_shifted(name, i, tolerance.inertia) for name, n in (("center", 3), ("inertia", 6)) for i in range(n)]
    return [_scaled("mass", tolerance.inertia), *inertial, _scaled("rotor_inertia", tolerance.rotor_inertia)]


def _nuisance(
    owner: Table, truth: Table, tolerance: Tolerance, thin: tuple, friction: np.ndarray, floor: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Columns of one sigma each, ``(n nv, p)`` in noise floors, and where the truth lies, ``(p,)`` in sigmas."""
    base, columns, places, actives = rigid_torque(owner, *thin), [], [], owner.active
    for i, (mine, true) in enumerate(zip(owner.links, truth.links, strict=True)):
        for sigma, move, place in _moves(tolerance):
            moved = move(mine, SMALL * sigma)
            if moved == mine:
                continue
            columns.append((rigid_torque(owner.with_link(i, moved), *thin) - base) / (SMALL * floor))
            places.append(place(mine, true) / sigma)
        for part, name in enumerate(("viscous", "coulomb")):
            if tolerance.friction == 0.0 or getattr(mine, name) == 0.0:
                continue
            column, j = np.zeros_like(base), actives.index(i)
            column[:, j] = tolerance.friction * getattr(mine, name) * friction[part, :, j] / floor[j]
            columns.append(column)
            places.append((getattr(true, name) / getattr(mine, name) - 1.0) / tolerance.friction)
    if not columns:
        return np.empty((base.size, 0)), np.empty(0)
    return np.stack([c.reshape(-1) for c in columns], axis=1), np.array(places)


def ruler(owner: Table, truth: Table, tolerance: Tolerance, session: Session, run: Run) -> Ruler:
    """Measures the run without anything wrong once, so that every other run can be compared with it."""
    rate = session.rate
    q, v, a = seen_motion(run, rate)
    thin = (thinned(q, rate), thinned(v, rate), thinned(a, rate))
    friction = np.stack([thin[1], banded(np.tanh(v / 5e-3), rate)])
    floor = noise_floor(owner, session, run)
    columns, place = _nuisance(owner, truth, tolerance, thin, friction, floor)
    basis, triangle = np.linalg.qr(columns) if columns.size else (columns, columns[:0])
    base = unexplained_torque(run, truth, session)
    tau = banded(at_samples(run.command), rate)
    return Ruler(truth, session, run, (*thin, tau), floor, base, (basis, triangle), place)
