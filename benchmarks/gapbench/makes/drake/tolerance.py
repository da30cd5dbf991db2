"""What of a change the tolerance of the model explains, and which other effects do as well as the true one."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import lsq_linear

from .effects import turned
from .measure import BAND, STILL, Even, Ruler, rms, size_of, smoothed
from .plant import Plant
from .robots import TWO_SIGMA, Part, Robot
from .session import LEAD

SAME = 0.1  # noise floors: what a rival may leave more than the truth and still be its like
RATE = 125.0  # [Hz]: columns need no more samples for a band of 20 Hz
PARAMETERS = {
    "direction_dependent_friction": 4,
    "stribeck_friction": 3,
    "presliding_friction": 2,
    "joint_coupling": 4,
    "cogging": 3,
    "payload": 4,
    "inertial_parameters": 10,
    "base_tilt": 2,
    "parasitic_spring": 2,
    "encoder_eccentricity": 3,
}
POSITIVE = (
    "viscous_friction",
    "coulomb_friction",
    "load_dependent_friction",
    "rotor_inertia",
    "input_delay",
    "actuator_lag",
)


@dataclass(frozen=True)
class Columns:
    """Changes of the residual to first order [noise floors]: each array of shape ``(N n, k)``."""

    of: np.ndarray
    low: np.ndarray
    high: np.ndarray


class Workshop:
    """Columns of one session, thinned out; a class, because all of them need the same samples."""

    def __init__(self, ruler: Ruler) -> None:
        rate, base = ruler.setup.rate, ruler.base
        self.every = max(1, int(rate // RATE))
        self.rate = rate / self.every
        ends = int(np.ceil(LEAD * rate))
        self.cut = slice(ends // self.every, (len(base.t) - ends - 1 - ends % self.every) // self.every + 1)
        thin = slice(ends % self.every, None, self.every)
        self.even = Even(*(getattr(base, name)[thin] for name in ("t", "q", "v", "a", "speed", "torque")))
        self.ruler, self.truth = ruler, ruler.setup.truth
        self.slow = np.stack([smoothed(x, self.rate, BAND) for x in self.even.torque.T], axis=1)
        moving = np.abs(self.even.speed) > STILL * self.truth.array("speed")
        # At rest dry friction is what is asked of it, and a change of its level no change.
        self.sign = np.sign(self.even.speed) * moving
        self.nominal = ruler.plant.torque(self.even.q, self.even.v, self.even.a)

    def thinned(self, change: np.ndarray) -> np.ndarray:
        """A change at the samples of the columns, shape ``(M, n)``."""
        return change[:: self.every]

    def column(self, torque: np.ndarray) -> np.ndarray:
        """A torque that the joints lack, as a column [noise floors], shape ``(M n,)``."""
        out = smoothed(torque, self.rate, BAND)[self.cut] / self.ruler.floor
        return out.ravel()

    def of_robot(self, robot: Robot) -> np.ndarray:
        """What another robot needs more [N m], shape ``(M', n)``."""
        return Plant(robot).torque(self.even.q, self.even.v, self.even.a) - self.nominal

    def on_joint(self, j: int, torque: np.ndarray) -> np.ndarray:
        """A torque of one joint as a column."""
        out = np.zeros_like(self.even.q)
        out[:, j] = torque
        return self.column(out)


def _moved_part(part: Part, quantity: int, size: float) -> Part:
    """Mass, centre in x, y, z or inertia moved by nearly nothing, in the measure of ``size``."""
    if quantity == 0:
        return replace(part, mass=part.mass * (1.0 + size))
    if quantity < 4:
        center = np.array(part.center)
        center[quantity - 1] += size * max(float(np.linalg.norm(part.center)), 0.02)
        return replace(part, center=tuple(center))
    inertia = list(part.inertia)
    inertia[quantity - 4] *= 1.0 + size
    return replace(part, inertia=tuple(inertia))


def tolerance_columns(shop: Workshop) -> Columns:
    """What every modelled quantity adds when it moves by two tolerances; coefficients between -1 and 1."""
    truth, tolerance, small = shop.truth, shop.ruler.setup.tolerance, 1e-3
    out = []
    for j, part in enumerate(truth.parts):
        for quantity in range(7):
            torque = shop.of_robot(truth.with_part(j, _moved_part(part, quantity, small))) / small
            out.append(shop.column(TWO_SIGMA * tolerance.inertia * torque))
        friction = TWO_SIGMA * tolerance.friction
        out.append(shop.on_joint(j, friction * part.dry * shop.sign[:, j]))
        out.append(shop.on_joint(j, friction * part.wet * shop.even.v[:, j]))
        out.append(shop.on_joint(j, TWO_SIGMA * tolerance.rotor_inertia * part.rotor * shop.even.a[:, j]))
    of = np.stack(out, axis=1)
    return Columns(of, -np.ones(of.shape[1]), np.ones(of.shape[1]))


def _left(columns: Columns, change: np.ndarray) -> np.ndarray:
    """What the best coefficients leave of a change, shape ``(M, n)``."""
    used = np.abs(columns.of).max(axis=0) > 1e-9
    bounds = (columns.low[used], columns.high[used])
    fit = lsq_linear(columns.of[:, used], change.ravel(), bounds=bounds, tol=1e-8)
    return change - (columns.of[:, used] @ fit.x).reshape(change.shape)


def beyond_tolerance(change: np.ndarray, shop: Workshop, columns: Columns) -> float:
    """What moves within two tolerances leave of a change, over the joints that it reaches [noise floors]."""
    thin = shop.thinned(change)
    reached = rms(thin) >= 0.1 * rms(thin).max()
    return float(np.sqrt((_left(columns, thin)[:, reached] ** 2).mean())) if size_of(change) else 0.0


def _of_joint(shop: Workshop, j: int) -> dict[str, list[np.ndarray]]:
    """Columns of the effects of one joint that are linear in what they lack."""
    even, truth, dt = shop.even, shop.truth, 1.0 / shop.rate
    sign, v = shop.sign[:, j], even.v[:, j]
    link = shop.nominal[:, j]
    ahead = even.q.copy()
    ahead[:, j] += 1e-4
    offset = (shop.ruler.plant.torque(ahead, even.v, even.a) - shop.nominal) / 1e-4
    slope = np.gradient(shop.slow[:, j], dt)

    def on(*torques: np.ndarray) -> list[np.ndarray]:
        return [shop.on_joint(j, torque) for torque in torques]

    part = truth.parts[j]
    masses = [_moved_part(part, quantity, 1e-3) for quantity in range(7)]
    return {
        "viscous_friction": on(v),
        "coulomb_friction": on(sign),
        "direction_dependent_friction": on(sign > 0, -1.0 * (sign < 0), v * (sign > 0), v * (sign < 0)),
        "load_dependent_friction": on(np.abs(link) * sign),
        "torque_constant": on(-even.torque[:, j]),
        "torque_offset": on(np.ones_like(v)),
        "rotor_inertia": on(even.a[:, j]),
        "parasitic_spring": on(even.q[:, j], np.ones_like(v)),
        "input_delay": on(slope),
        "actuator_lag": on(slope - np.gradient(slope, dt) * 2e-3),
        "encoder_offset": [-shop.column(offset)],
        "inertial_parameters": [shop.column(shop.of_robot(truth.with_part(j, moved)) / 1e-3) for moved in masses],
    }


def _of_whole(shop: Workshop) -> dict[str, list[np.ndarray]]:
    """Columns of the effects of the whole robot."""
    truth, gravity, dt = shop.truth, np.array(shop.truth.gravity), 1.0 / shop.rate
    slope = np.gradient(shop.slow, dt, axis=0)
    tilts = [replace(truth, gravity=tuple(turned(gravity, 1e-3 * axis))) for axis in np.eye(3)[:2]]
    places = [np.zeros(3), *(0.1 * np.eye(3))]
    loads = [replace(truth, payload=(1e-2, tuple(place))) for place in places]
    return {
        "base_tilt": [shop.column(shop.of_robot(robot) / 1e-3) for robot in tilts],
        "payload": [shop.column(shop.of_robot(robot) / 1e-2) for robot in loads],
        "input_delay": [shop.column(slope)],
        "actuator_lag": [shop.column(slope - np.gradient(slope, dt, axis=0) * 2e-3)],
    }


def _with(columns: Columns, more: list[np.ndarray], positive: bool) -> Columns:
    low = np.zeros(len(more)) if positive else np.full(len(more), -np.inf)
    # Each of the size of one noise floor, so that the fit meets no numbers of very different size.
    scaled = [x / max(float(np.sqrt((x**2).mean())), 1e-9) for x in more]
    return Columns(
        np.column_stack([columns.of, *scaled]),
        np.concatenate([columns.low, low]),
        np.concatenate([columns.high, np.full(len(more), np.inf)]),
    )


def alike(name: str, joint: str | None, change: np.ndarray, shop: Workshop, columns: Columns) -> list[dict]:
    """Effects with no more parameters that leave hardly more of a change than the truth, to the same order.

    Candidates are those that are linear in what they lack; what they leave is over all joints [noise floors].
    """
    table: dict[tuple[str, str | None], list[np.ndarray]] = {
        (effect, part.joint): made
        for j, part in enumerate(shop.truth.parts)
        for effect, made in _of_joint(shop, j).items()
    }
    table |= {(effect, None): made for effect, made in _of_whole(shop).items()}
    thin = shop.thinned(change)

    def leaves(effect: str, where: str | None) -> float:
        left = _left(_with(columns, table[effect, where], effect in POSITIVE), thin)
        return float(np.sqrt((left**2).mean()))

    own = leaves(name, joint) if (name, joint) in table else 0.0
    within = float(np.sqrt((_left(columns, thin) ** 2).mean()))
    out = []
    for effect, where in table:
        if (effect, where) == (name, joint) or PARAMETERS.get(effect, 1) > PARAMETERS.get(name, 1):
            continue
        left = leaves(effect, where)
        # What explains hardly anything is nobody's like, however small the whole is.
        if left < min(own + SAME, 0.5 * within):
            out.append({"effect": effect, "joint": where, "leaves": left})
    return out
