"""The laws of the cases, written from their equations; this module does not import the code under test.

Each gives the torque that the drive of one joint has to give in addition to the modelled torque, and its inputs.
Equivalent inputs are one: ``v`` and ``dx`` both contain the direction of motion, ``tl`` and ``tau`` both the load.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

Array = np.ndarray


@dataclass(frozen=True)
class State:
    """Motion and torque of a joint and its robot at the full rate, in SI units.

    Attributes:
        t: Time, ``(N,)``.
        q, v: Motion of all joints, ``(N, nv)``.
        need: Torque of the true robot without the law, ``(N, nv)``.
        link: The same torque without friction and rotors.
        j: Index of the joint.
        names: Names of the joints.
    """

    t: Array
    q: Array
    v: Array
    need: Array
    link: Array
    j: int
    names: tuple[str, ...]

    @property
    def dt(self) -> float:
        return float(self.t[1] - self.t[0])

    def name(self, kind: str) -> str:
        """Name of an input of the joint; ``freq(v)`` means that its response to ``v`` depends on the frequency."""
        own = self.names[self.j]
        if kind.startswith("freq("):
            return f"{kind[:-1]}.{own})"
        return kind if kind == "t" else f"{kind}.{own}"


@dataclass(frozen=True)
class Law:
    """A law with its inputs.

    Attributes:
        parts: Torque for unit amplitudes, ``(N, k)``: the law is their weighted sum.
        required: Inputs that an answer has to name, each a set of equivalent inputs.
        allowed: Other inputs that an answer may name.
        temperature: Temperature of the joint's drive [deg C], or None if it is not logged.
    """

    parts: Array
    required: tuple[frozenset[str], ...]
    allowed: frozenset[str]
    temperature: Array | None = None


def _law(state: State, parts: list[Array], required: str, allowed: str = "", temperature: Array | None = None) -> Law:
    """Make a law; ``required`` has the form ``"q v|dx"``."""
    needs = tuple(frozenset(state.name(k) for k in group.split("|")) for group in required.split())
    also = frozenset(state.name(k) for k in allowed.split()).union(*needs)
    return Law(np.column_stack(parts), needs, also, temperature)


def _dahl(x: Array, reach: float) -> Array:
    """``dz/dx = (1 - z sign(dx)) / reach``, integrated exactly over each step."""
    z = np.zeros(len(x))
    for k in range(1, len(x)):
        step = x[k] - x[k - 1]
        side = np.sign(step)
        z[k] = side + (z[k - 1] - side) * np.exp(-abs(step) / reach)
    return z


def _slip(x: Array, reach: float) -> Array:
    """An elastic element that slides at a force of one: the Maxwell element."""
    z = np.zeros(len(x))
    for k in range(1, len(x)):
        z[k] = min(1.0, max(-1.0, z[k - 1] + (x[k] - x[k - 1]) / reach))
    return z


def _lugre(x: Array, v: Array, dt: float, reach: float, excess: float, speed: float) -> Array:
    """Bristle deflection divided by its steady value, with ``g(v) = 1 + excess exp(-(v/speed)^2)``."""
    z = np.zeros(len(x))
    for k in range(1, len(x)):
        g = 1.0 + excess * np.exp(-((v[k] / speed) ** 2))
        side, step = np.sign(v[k]), abs(v[k]) * dt
        z[k] = side * g + (z[k - 1] - side * g) * np.exp(-step / (reach * g))
    return z


def harmonic_drive_hysteresis(state: State, rng: np.random.Generator) -> Law:
    """Torque loss in the flexspline: a hysteresis over displacement whose height grows with the load."""
    j, x = state.j, state.q[:, state.j]
    z = _dahl(x, rng.uniform(0.02, 0.08) * np.ptp(x))
    load = np.abs(state.link[:, j])
    return _law(state, [z, rng.uniform(1.0, 3.0) * z * load / max(load.mean(), 1e-9)], "dx tl|tau", "v")


def _heated(state: State, rng: np.random.Generator) -> Array:
    """Temperature of a drive that losses heat towards a final temperature, with slowly varying cooling."""
    t = state.t
    rise = 1.0 - np.exp(-t / rng.uniform(0.25, 0.6) / t[-1])
    return 25.0 + rng.uniform(8, 25) * (rise + 0.15 * np.sin(2 * np.pi * t / t[-1] * rng.uniform(1.2, 2.2)))


def friction_with_temperature(state: State, rng: np.random.Generator) -> Law:
    """Coulomb friction that grows with the logged temperature."""
    warm = _heated(state, rng)
    s = np.sign(state.v[:, state.j])
    return _law(state, [s * (warm - 25.0) / 10.0, rng.uniform(0, 0.5) * s], "v|dx temp", "", warm)


def friction_with_hidden_temperature(state: State, rng: np.random.Generator) -> Law:
    """Coulomb friction that grows with a temperature that is not logged, so it changes with time."""
    warm = _heated(state, rng)
    s = np.sign(state.v[:, state.j])
    return _law(state, [s * (warm - 25.0) / 10.0, rng.uniform(0, 0.5) * s], "v|dx t")


def voltage_sag(state: State, rng: np.random.Generator) -> Law:
    """A drive that gives less when all drives command more: the command is larger by the lost share."""
    load = np.abs(state.need).sum(axis=1)
    behind, keep = np.zeros(len(load)), np.exp(-state.dt / rng.uniform(0.02, 0.3))
    behind[0] = load[0]
    for k in range(1, len(load)):
        behind[k] = keep * behind[k - 1] + (1.0 - keep) * load[k]
    part = state.need[:, state.j] * (behind / load.mean() - 1.0)
    loads = [f"{kind}.{name}" for kind in ("tau", "tl") for name in state.names]
    own = frozenset({state.name("tau"), state.name("tl")})
    return Law(part[:, None], (own,), frozenset(loads))


def friction_with_position(state: State, rng: np.random.Generator) -> Law:
    """A worn or misaligned screw: Coulomb friction with a bump or a wave over the travel."""
    x, s = state.q[:, state.j], np.sign(state.v[:, state.j])
    low, wide = x.min(), np.ptp(x)
    if rng.random() < 0.5:
        place = low + rng.uniform(0.3, 0.7) * wide
        shape = np.exp(-(((x - place) / (rng.uniform(0.1, 0.25) * wide)) ** 2))
    else:
        shape = 0.5 + 0.5 * np.sin(2 * np.pi * (x - low) / wide * rng.uniform(0.6, 2.5) + rng.uniform(0, 6.28))
    return _law(state, [s * shape], "q v|dx", "dx v")


def ripple_with_torque(state: State, rng: np.random.Generator) -> Law:
    """Torque ripple of a motor or gear: periodic in its angle, proportional to the torque."""
    x, load = state.q[:, state.j], state.link[:, state.j]
    order = rng.integers(6, 16) * 2 * np.pi / np.ptp(x)
    return _law(state, [load * np.sin(order * x + rng.uniform(0, 6.28))], "q tl|tau", "tl tau")


def drifting_cable(state: State, rng: np.random.Generator) -> Law:
    """A cable that loses or gains tension: its pull on the joint changes with time."""
    t = state.t / state.t[-1]
    shape = np.exp(-t / rng.uniform(0.15, 0.5)) if rng.random() < 0.6 else np.cos(np.pi * t * rng.uniform(0.8, 2.0))
    return _law(state, [shape], "t")


def hose(state: State, rng: np.random.Generator) -> Law:
    """A hose: slack over part of the travel, then a pull with the cube or the square of the stretch."""
    x = state.q[:, state.j] * rng.choice([-1.0, 1.0])
    stretch = np.maximum(x - (x.min() + rng.uniform(0.3, 0.6) * np.ptp(x)), 0.0)
    return _law(state, [stretch ** rng.choice([2.0, 3.0])], "q")


def hardening_spring(state: State, rng: np.random.Generator) -> Law:
    """A hardening spring: linear and cubic in the distance from its rest position."""
    x = state.q[:, state.j]
    d = (x - (x.min() + rng.uniform(0.3, 0.7) * np.ptp(x))) / np.ptp(x)
    return _law(state, [d**3, rng.uniform(0.0, 0.1) * d], "q")


def dahl_friction(state: State, rng: np.random.Generator) -> Law:
    """Dahl's model."""
    x = state.q[:, state.j]
    return _law(state, [_dahl(x, rng.uniform(0.05, 0.2) * np.ptp(x))], "dx", "v")


def lugre_friction(state: State, rng: np.random.Generator) -> Law:
    """The LuGre model, with a Stribeck excess."""
    j = state.j
    speed = rng.uniform(0.05, 0.2) * np.percentile(np.abs(state.v[:, j]), 90)
    reach = rng.uniform(0.02, 0.08) * np.ptp(state.q[:, j])
    z = _lugre(state.q[:, j], state.v[:, j], state.dt, reach, rng.uniform(0.5, 1.5), speed)
    return _law(state, [z], "dx", "v")


def maxwell_slip(state: State, rng: np.random.Generator) -> Law:
    """Generalised Maxwell slip: elements that begin to slide one after the other."""
    x = state.q[:, state.j]
    reaches = np.array([0.03, 0.1, 0.3]) * rng.uniform(0.6, 1.2) * np.ptp(x)
    shares = rng.dirichlet([2.0, 2.0, 2.0])
    return _law(state, [np.column_stack([_slip(x, r) for r in reaches]) @ shares], "dx", "v")


def friction_by_direction_and_position(state: State, rng: np.random.Generator) -> Law:
    """Coulomb friction that depends on the position, differently forwards and backwards."""
    x, s = state.q[:, state.j], np.sign(state.v[:, state.j])
    u = (x - x.min()) / np.ptp(x)
    forwards = np.where(s > 0, 0.3 + rng.uniform(0.5, 1.0) * u**2, 0.0)
    backwards = np.where(s < 0, -(0.3 + rng.uniform(0.5, 1.0) * (1.0 - u)), 0.0)
    return _law(state, [forwards, backwards], "q v|dx", "dx v")


def _first_order(x: Array, dt: float, corner_hz: float) -> Array:
    """``y' = 2 pi f (x - y)`` with the input linear over each step, at rest at the start."""
    y, wt = np.full(len(x), x[0]), 2.0 * np.pi * corner_hz * dt
    keep = np.exp(-wt)
    before, now = (1.0 - keep) / wt - keep, 1.0 - (1.0 - keep) / wt
    for k in range(1, len(x)):
        y[k] = keep * y[k - 1] + before * x[k - 1] + now * x[k]
    return y


def _second_order(x: Array, dt: float, hz: float, damping: float) -> Array:
    """``y'' + 2 d w y' + w^2 y = w^2 x``, integrated in steps of a tenth of the samples (semi-implicit Euler)."""
    w, fine = 2.0 * np.pi * hz, 10
    y, rate, out = x[0], 0.0, np.full(len(x), x[0])
    for k in range(1, len(x)):
        for part in range(fine):
            now = x[k - 1] + (x[k] - x[k - 1]) * (part + 1) / fine
            rate += dt / fine * (w * w * (now - y) - 2.0 * damping * w * rate)
            y += dt / fine * rate
        out[k] = y
    return out


def _dynamic(state: State, part: Array, *, of_torque: bool) -> Law:
    """A law that responds dynamically to the motion or the torque, with the equivalent inputs.

    A response to a position is a response to its velocity with another gain and phase. ``tl`` and ``tau`` differ by
    friction, whose steps are delayed with the torque and depend on ``v`` or ``dx``. On a linear axis all torque except
    friction is acceleration and weight, so motion and torque are equivalent.
    """
    motion, load = "freq(q)|freq(v)|freq(a)", "freq(tl)|freq(tau)"
    a = np.gradient(state.v[:, state.j], state.dt)
    same = abs(np.corrcoef(a, state.link[:, state.j])[0, 1]) > 0.99
    required = f"{motion}|{load}" if same else load if of_torque else motion
    return _law(state, [part], required, "v dx" if of_torque else "")


def viscoelastic_hose(state: State, rng: np.random.Generator) -> Law:
    """A hose that creeps: spring and damper in series (Maxwell), stiff in fast motion, soft in slow motion."""
    pull = _first_order(state.v[:, state.j], state.dt, np.exp(rng.uniform(np.log(0.15), np.log(1.5))))
    return _dynamic(state, pull, of_torque=False)


def elastic_appendage(state: State, rng: np.random.Generator) -> Law:
    """A tool, a load or a liquid on a spring with a resonance: its reaction to the joint's acceleration."""
    a = np.gradient(state.v[:, state.j], state.dt)
    return _dynamic(state, _second_order(a, state.dt, rng.uniform(0.7, 2.5), rng.uniform(0.05, 0.3)), of_torque=False)


def filtered_torque(state: State, rng: np.random.Generator) -> Law:
    """A torque that a filter with a low corner frequency changed in the drive or the sensor: the lost part."""
    need = state.need[:, state.j]
    return _dynamic(state, _first_order(need, state.dt, rng.uniform(1.0, 4.0)) - need, of_torque=True)


def late_torque(state: State, rng: np.random.Generator) -> Law:
    """A torque that is delayed by a bus or a buffer, without a trace in the time stamps."""
    need = state.need[:, state.j]
    late = np.interp(state.t - rng.uniform(0.02, 0.1), state.t, need)
    return _dynamic(state, late - need, of_torque=True)


LAWS: dict[str, Callable[[State, np.random.Generator], Law]] = {
    law.__name__: law
    for law in (
        harmonic_drive_hysteresis,
        friction_with_temperature,
        friction_with_hidden_temperature,
        voltage_sag,
        friction_with_position,
        ripple_with_torque,
        drifting_cable,
        hose,
        hardening_spring,
        dahl_friction,
        lugre_friction,
        maxwell_slip,
        friction_by_direction_and_position,
    )
}

# Linear but dynamic laws: gain and phase depend on the frequency. They alternate separately, so that the seeds of
# the others keep their cases.
DYNAMIC: dict[str, Callable[[State, np.random.Generator], Law]] = {
    law.__name__: law for law in (viscoelastic_hose, elastic_appendage, filtered_torque, late_torque)
}
