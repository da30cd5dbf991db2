"""Effects of the catalogue on a robot of this make: each a law with one magnitude that its size is sought with."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from .departures import Coupling, Departures
from .measure import Ruler, rms
from .robots import Robot, encoder_step

Change = Callable[[Robot, Departures, float], tuple[Robot, Departures]]
Parameters = dict[str, object]


@dataclass(frozen=True)
class Effect:
    """An effect whose kind and shape are drawn and whose magnitude is not.

    Attributes:
        name: In the contract's words; of a cause outside the catalogue its own.
        joint: As an answer names it; None for the whole robot.
        change: Robot and departures with the effect at a magnitude.
        parameters: As an answer states them.
        start: Magnitude to begin with: about one noise floor.
        most: Largest magnitude that is physically plausible.
    """

    name: str
    joint: str | None
    change: Change
    parameters: Callable[[float], Parameters]
    start: float
    most: float = np.inf


@dataclass(frozen=True)
class Place:
    """A joint with what is usual there; index, name and the session's ruler."""

    j: int
    name: str
    rng: np.random.Generator
    ruler: Ruler

    @property
    def floor(self) -> float:
        return float(self.ruler.floor[self.j])

    def of(self, name: str) -> float:
        """Root mean square of ``v``, ``a`` or ``torque`` of this joint in the session."""
        return float(rms(getattr(self.ruler.base, name))[self.j])

    @property
    def span(self) -> tuple[float, float]:
        q = self.ruler.base.q[:, self.j]
        return float(q.min()), float(q.max())

    @property
    def sign(self) -> float:
        return float(self.rng.choice((-1.0, 1.0)))


At = int | tuple[int, int]


def _number(place: Place, name: str, array: str, at: At, *, said: str, start: float, most: float) -> Effect:
    """An effect that is one number of one joint."""
    return Effect(
        name,
        place.name,
        lambda robot, of, s: (robot, of.set(array, at, s)),
        lambda s: {said: s},
        start,
        most,
    )


def _viscous(p: Place) -> Effect:
    def change(robot: Robot, of: Departures, s: float) -> tuple[Robot, Departures]:
        return robot, of.set("wet", (p.j, 0), s).set("wet", (p.j, 1), s)

    return Effect("viscous_friction", p.name, change, lambda s: {"coefficient": s}, p.floor / p.of("v"))


def _coulomb(p: Place) -> Effect:
    def change(robot: Robot, of: Departures, s: float) -> tuple[Robot, Departures]:
        return robot, of.set("dry", (p.j, 0), s).set("dry", (p.j, 1), s)

    return Effect("coulomb_friction", p.name, change, lambda s: {"torque": s}, p.floor)


def _directed(p: Place) -> Effect:
    more, less = p.rng.uniform(1.2, 2.0), p.rng.uniform(0.1, 0.5)
    dry = (more, less) if p.sign > 0 else (less, more)
    wet = p.rng.uniform(0.0, 1.0, 2) / p.of("v")

    def change(robot: Robot, of: Departures, s: float) -> tuple[Robot, Departures]:
        for side in (0, 1):
            of = of.set("dry", (p.j, side), s * dry[side]).set("wet", (p.j, side), s * wet[side])
        return robot, of

    names = ("torque_positive", "torque_negative", "coefficient_positive", "coefficient_negative")
    shape = (*dry, *map(float, wet))

    def said(s: float) -> Parameters:
        return {n: s * x for n, x in zip(names, shape, strict=True)}

    return Effect("direction_dependent_friction", p.name, change, said, p.floor)


def _stribeck(p: Place) -> Effect:
    share, speed = p.rng.uniform(0.2, 0.5), p.rng.uniform(0.3, 1.2) * p.of("v")

    def change(robot: Robot, of: Departures, s: float) -> tuple[Robot, Departures]:
        of = of.set("dry", (p.j, 0), s * share).set("dry", (p.j, 1), s * share)
        return robot, of.set("static", p.j, s * (1.0 - share)).set("stribeck", p.j, speed)

    def said(s: float) -> Parameters:
        return {"coulomb_torque": s * share, "static_torque": s, "stribeck_velocity": speed}

    return Effect("stribeck_friction", p.name, change, said, 1.5 * p.floor)


def _presliding(p: Place) -> Effect:
    low, high = p.span
    bend = (high - low) * float(np.exp(p.rng.uniform(np.log(0.01), np.log(0.08))))

    def change(robot: Robot, of: Departures, s: float) -> tuple[Robot, Departures]:
        return robot, of.set("soft", (p.j, 0), s).set("soft", (p.j, 1), bend)

    return Effect("presliding_friction", p.name, change, lambda s: {"torque": s, "displacement": bend}, p.floor)


def _load(p: Place) -> Effect:
    start = p.floor / p.of("torque")
    return _number(p, "load_dependent_friction", "load", p.j, said="ratio", start=start, most=0.6)


def _backlash(p: Place) -> Effect:
    wide = p.span[1] - p.span[0]
    return _number(p, "backlash", "gap", p.j, said="gap", start=3e-3 * wide, most=0.05 * wide)


def _compliance(p: Place) -> Effect:
    part, torque = p.ruler.setup.truth.parts[p.j], p.of("torque")
    link = float(np.diag(p.ruler.plant.equation(p.ruler.base.q[0], 0.0 * p.ruler.base.q[0])[0])[p.j])
    both = part.rotor * link / (part.rotor + link)
    loop = p.rng.uniform(0.02, 0.08) * torque

    def change(robot: Robot, of: Departures, s: float) -> tuple[Robot, Departures]:
        return robot, of.set("stiffness", p.j, 1.0 / s).set("hysteresis", p.j, loop)

    soft = 1.0 / (both * (2.0 * np.pi * 6.0) ** 2)

    # The hysteresis adds to the secant what its level is of the torque of a usual twist.
    def said(s: float) -> Parameters:
        return {"stiffness": (1.0 + loop / torque) / s}

    return Effect("transmission_compliance", p.name, change, said, soft / 8.0, soft)


def _coupling(p: Place) -> Effect:
    i = p.j if p.j + 1 < len(p.ruler.floor) else p.j - 1
    ratio = p.sign * p.rng.uniform(0.3, 1.0)
    speed, rate = p.of("v"), p.of("a")
    wet, inertia = p.rng.uniform(0.0, 0.5) / speed, p.rng.uniform(0.0, 0.3) / rate
    parts = p.ruler.setup.truth.parts

    def change(robot: Robot, of: Departures, s: float) -> tuple[Robot, Departures]:
        return robot, replace(of, coupling=Coupling(i, i + 1, ratio, s, s * wet, s * inertia))

    def said(s: float) -> Parameters:
        return {"ratio": ratio, "coulomb_torque": s, "coefficient": s * wet, "inertia": s * inertia}

    return Effect("joint_coupling", f"{parts[i].joint}+{parts[i + 1].joint}", change, said, p.floor)


def _cogging(p: Place) -> Effect:
    low, high = p.span
    order = float(np.ceil(2.0 * np.pi * p.rng.uniform(11.0, 18.0) / (high - low)))
    phase = float(p.rng.uniform(-np.pi, np.pi))

    def change(robot: Robot, of: Departures, s: float) -> tuple[Robot, Departures]:
        return robot, replace(of, ripple=(*of.ripple, (p.j, order, s, phase)))

    return Effect(
        "cogging", p.name, change, lambda s: {"order": [order], "amplitude": [s], "phase": [phase]}, 1.5 * p.floor
    )


def _saturation(p: Place) -> Effect:
    peak = float(np.abs(p.ruler.base.torque[:, p.j]).max())
    return Effect(
        "torque_saturation",
        p.name,
        lambda robot, of, s: (robot, of.set("limit", p.j, peak * (1.0 - s))),
        lambda s: {"limit": peak * (1.0 - s)},
        0.15,
        0.7,
    )


def _constant(p: Place) -> Effect:
    sign = p.sign
    return Effect(
        "torque_constant",
        p.name,
        lambda robot, of, s: (robot, of.set("ratio", p.j, 1.0 + sign * s)),
        lambda s: {"ratio": 1.0 + sign * s},
        p.floor / p.of("torque"),
        0.45 if sign < 0 else 0.9,
    )


def _offset(p: Place) -> Effect:
    sign = p.sign
    return Effect(
        "torque_offset",
        p.name,
        lambda robot, of, s: (robot, of.set("offset", p.j, sign * s)),
        lambda s: {"torque": sign * s},
        p.floor,
    )


def _late(p: Place, name: str, array: str, parameter: str, most: float) -> Effect:
    base = p.ruler.base
    slope = float(rms(np.gradient(base.torque, base.t[1] - base.t[0], axis=0))[p.j])
    whole, n = p.rng.random() < 0.5, len(p.ruler.floor)

    def change(robot: Robot, of: Departures, s: float) -> tuple[Robot, Departures]:
        for j in range(n) if whole else (p.j,):
            of = of.set(array, j, s)
        return robot, of

    start = min(2.0 * p.floor / slope, 0.3 * most)
    return Effect(name, None if whole else p.name, change, lambda s: {parameter: s}, start, most)


def _delay(p: Place) -> Effect:
    return _late(p, "input_delay", "delay", "delay", 0.025)


def _lag(p: Place) -> Effect:
    return _late(p, "actuator_lag", "lag", "time_constant", 0.04)


def _rotor(p: Place) -> Effect:
    return _number(p, "rotor_inertia", "rotor", p.j, said="inertia", start=p.floor / p.of("a"), most=np.inf)


def _payload(p: Place) -> Effect:
    center = tuple(float(x) for x in np.array(p.ruler.setup.truth.parts[-1].center) + p.rng.normal(0.0, 0.05, 3))
    heavy = sum(part.mass for part in p.ruler.setup.truth.parts)

    def change(robot: Robot, of: Departures, s: float) -> tuple[Robot, Departures]:
        return replace(robot, payload=(s, center)), of

    def said(s: float) -> Parameters:
        return {"mass": s, **{f"center_{axis}": x for axis, x in zip("xyz", center, strict=True)}}

    return Effect("payload", None, change, said, 0.01 * heavy, heavy)


def _inertial(p: Place) -> Effect:
    # Mass added at a place off the centre: what a casting, a hose clamp or a motor that no drawing has would do.
    part = p.ruler.setup.truth.parts[p.j]
    at = np.array(part.center) + p.rng.normal(0.0, 0.6, 3) * max(float(np.linalg.norm(part.center)), 0.05)

    def change(robot: Robot, of: Departures, s: float) -> tuple[Robot, Departures]:
        now = robot.parts[p.j]
        mass = now.mass + s
        center = (now.mass * np.array(now.center) + s * at) / mass
        spread = s * now.mass / mass * float(((at - np.array(now.center)) ** 2).sum())
        inertia = tuple(x + 2.0 / 3.0 * spread for x in now.inertia)
        return robot.with_part(p.j, replace(now, mass=mass, center=tuple(center), inertia=inertia)), of

    def said(s: float) -> Parameters:
        return {"mass": s, **{f"center_{axis}": float(x) for axis, x in zip("xyz", at, strict=True)}}

    return Effect("inertial_parameters", p.name, change, said, 0.05 * part.mass, 3.0 * part.mass)


def turned(vector: np.ndarray, r: np.ndarray) -> np.ndarray:
    """exp([r]x) applied to a vector (Rodrigues)."""
    angle = float(np.linalg.norm(r))
    if angle == 0.0:
        return vector
    axis = r / angle
    across = np.cross(axis, vector)
    return vector * np.cos(angle) + across * np.sin(angle) + axis * (axis @ vector) * (1.0 - np.cos(angle))


def _tilt(p: Place) -> Effect:
    way = p.rng.uniform(-np.pi, np.pi)
    axis = np.array([np.cos(way), np.sin(way), 0.0])

    def change(robot: Robot, of: Departures, s: float) -> tuple[Robot, Departures]:
        return replace(robot, gravity=tuple(turned(np.array(robot.gravity), s * axis))), of

    def said(s: float) -> Parameters:
        return {name: float(s * x) for name, x in zip(("roll", "pitch", "yaw"), axis, strict=True)}

    return Effect("base_tilt", None, change, said, 0.01, 0.3)


def _spring(p: Place) -> Effect:
    low, high = p.span
    rest = p.rng.uniform(low, high)
    usual = float(np.sqrt(((p.ruler.base.q[:, p.j] - rest) ** 2).mean()))

    def change(robot: Robot, of: Departures, s: float) -> tuple[Robot, Departures]:
        return robot, of.set("spring", (p.j, 0), s).set("spring", (p.j, 1), rest)

    return Effect(
        "parasitic_spring", p.name, change, lambda s: {"stiffness": s, "rest_position": rest}, p.floor / usual
    )


def _encoder_offset(p: Place) -> Effect:
    return _number(p, "encoder_offset", "reading", (p.j, 0), said="offset", start=0.01, most=0.3)


def _eccentricity(p: Place) -> Effect:
    phase, order = float(p.rng.uniform(-np.pi, np.pi)), int(p.rng.integers(1, 4))

    def change(robot: Robot, of: Departures, s: float) -> tuple[Robot, Departures]:
        return robot, of.set("reading", (p.j, 1), s).set("reading", (p.j, 2), phase).set("reading", (p.j, 3), order)

    return Effect(
        "encoder_eccentricity", p.name, change, lambda s: {"amplitude": s, "phase": phase, "order": order}, 0.01, 0.2
    )


def _quantization(p: Place) -> Effect:
    count = encoder_step(p.ruler.setup.truth.parts[p.j])
    wide = p.span[1] - p.span[0]
    start = max(3.0 * count, 1e-4 * wide)
    return _number(p, "encoder_quantization", "reading", (p.j, 4), said="step", start=start, most=0.03 * wide)


DRAWS: dict[str, Callable[[Place], Effect]] = {
    "viscous_friction": _viscous,
    "coulomb_friction": _coulomb,
    "direction_dependent_friction": _directed,
    "stribeck_friction": _stribeck,
    "presliding_friction": _presliding,
    "load_dependent_friction": _load,
    "backlash": _backlash,
    "transmission_compliance": _compliance,
    "joint_coupling": _coupling,
    "cogging": _cogging,
    "torque_saturation": _saturation,
    "torque_constant": _constant,
    "torque_offset": _offset,
    "input_delay": _delay,
    "actuator_lag": _lag,
    "rotor_inertia": _rotor,
    "payload": _payload,
    "inertial_parameters": _inertial,
    "base_tilt": _tilt,
    "parasitic_spring": _spring,
    "encoder_offset": _encoder_offset,
    "encoder_eccentricity": _eccentricity,
    "encoder_quantization": _quantization,
}
NAMES = tuple(DRAWS)
HINGES = ("cogging", "encoder_eccentricity", "encoder_quantization", "encoder_offset", "transmission_compliance")
REVERSALS = 6  # of the torque through a play, for it to show


def _reversals(torque: np.ndarray) -> int:
    """How often a torque changes its sign and means it: by a tenth of its level."""
    level = 0.1 * np.sqrt((torque**2).mean())
    signs = np.sign(torque[np.abs(torque) > level])
    return int((signs[1:] != signs[:-1]).sum())


def possible_joints(name: str, ruler: Ruler) -> list[int]:
    """Joints where an effect of this name could leave a trace."""
    parts = ruler.setup.truth.parts
    out = [j for j, part in enumerate(parts) if not (part.linear and name in HINGES)]
    if name == "encoder_offset":
        # About the vertical at the base, and where nothing after it depends on the angle, an offset is no difference.
        out = [j for j in out if j or abs(parts[0].axis[2]) < 0.5]
    if name == "backlash":
        out = [j for j in out if _reversals(ruler.base.torque[:, j] - parts[j].rotor * ruler.base.a[:, j]) >= REVERSALS]
    return out


def drawn_effect(rng: np.random.Generator, name: str, ruler: Ruler) -> Effect | None:
    """An effect of a name at a joint that may have it; None where no joint may."""
    joints = possible_joints(name, ruler)
    if not joints:
        return None
    j = int(rng.choice(joints))
    return DRAWS[name](Place(j, ruler.setup.truth.parts[j].joint, rng, ruler))
