"""The effects of the catalogue, each from its law, with one number that says how strong it is.

An effect is drawn with a shape (where, which way, at which speed) and gets its strength later, when runs have shown
what a strength leaves in the recording.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from .plant import ORDERS, add, put
from .robots import Robot
from .world import Scale, World, tilted, with_body, with_link

Array = np.ndarray
Rng = np.random.Generator
Parameters = Mapping[str, object]


@dataclass(frozen=True)
class Effect:
    """One effect of a shape that is drawn.

    Attributes:
        name: In the contract's words.
        joint: The joint, both joints of a coupling, None for the whole robot.
        put: The world with the effect at a strength.
        parameters: Its parameters at a strength.
        start: Ordinary strength.
        most: Largest strength that makes sense.
    """

    name: str
    joint: str | None
    put: Callable[[World, float], World]
    parameters: Callable[[float], Parameters]
    start: float
    most: float = np.inf


Law = Callable[[Robot, Scale, int, Rng], Effect | None]


def _planted(
    name: str,
    robot: Robot,
    j: int,
    given: Callable[[float], Parameters],
    kept: Callable,
    *,
    start: float,
    most: float = np.inf,
) -> Effect:
    """An effect that changes numbers of one joint: ``kept(plant, parameters)`` is the new plant."""
    return Effect(
        name,
        robot.names[j],
        lambda world, s: replace(world, plant=kept(world.plant, given(s))),
        given,
        start,
        most,
    )


def viscous(robot: Robot, scale: Scale, j: int, _: Rng) -> Effect:
    def law(plant, p):
        return add(plant, j, damp_forth=p["coefficient"], damp_back=p["coefficient"])

    unit = scale.torque[j] / scale.speed[j]
    return _planted("viscous_friction", robot, j, lambda s: {"coefficient": s * unit}, law, start=0.3)


def coulomb(robot: Robot, scale: Scale, j: int, _: Rng) -> Effect:
    def law(plant, p):
        return add(plant, j, forth=p["torque"], back=p["torque"])

    return _planted("coulomb_friction", robot, j, lambda s: {"torque": s * scale.torque[j]}, law, start=0.1)


def by_direction(robot: Robot, scale: Scale, j: int, rng: Rng) -> Effect:
    more, faster = rng.uniform(0.3, 0.8), rng.uniform(-0.8, 0.8)
    side = rng.choice((-1.0, 1.0))
    unit = scale.torque[j] / scale.speed[j]

    def parameters(s):
        level, slope = s * scale.torque[j], 0.6 * s * unit
        return {
            "torque_positive": level * (1 + side * more),
            "torque_negative": level * (1 - side * more),
            "coefficient_positive": slope * (1 + faster),
            "coefficient_negative": slope * (1 - faster),
        }

    def law(plant, p):
        plant = add(plant, j, forth=p["torque_positive"], back=p["torque_negative"])
        return add(plant, j, damp_forth=p["coefficient_positive"], damp_back=p["coefficient_negative"])

    return _planted("direction_dependent_friction", robot, j, parameters, law, start=0.1)


def stribeck(robot: Robot, scale: Scale, j: int, rng: Rng) -> Effect:
    higher, slide = rng.uniform(1.6, 3.0), scale.speed[j] * rng.uniform(0.04, 0.15)

    def parameters(s):
        level = s * scale.torque[j]
        return {"coulomb_torque": level, "static_torque": higher * level, "stribeck_velocity": slide}

    def law(plant, p):
        level, peak = p["coulomb_torque"], p["static_torque"]
        plant = add(plant, j, forth=level, back=level, static=peak - level)
        return put(plant, j, slide=p["stribeck_velocity"])

    return _planted("stribeck_friction", robot, j, parameters, law, start=0.1)


def presliding(robot: Robot, scale: Scale, j: int, rng: Rng) -> Effect:
    reach = scale.reach[j] * rng.uniform(0.02, 0.12)

    def law(plant, p):
        return put(plant, j, bristle=p["torque"], reach=p["displacement"])

    return _planted(
        "presliding_friction",
        robot,
        j,
        lambda s: {"torque": s * scale.torque[j], "displacement": reach},
        law,
        start=0.1,
    )


def loaded(robot: Robot, _scale: Scale, j: int, _: Rng) -> Effect:
    def law(plant, p):
        return put(plant, j, loaded=p["ratio"])

    return _planted("load_dependent_friction", robot, j, lambda s: {"ratio": s}, law, start=0.1, most=0.6)


def backlash(robot: Robot, scale: Scale, j: int, _: Rng) -> Effect | None:
    if not robot.rotor[j]:  # a motor without inertia has nothing to knock with, and no equation of motion
        return None

    def law(plant, p):
        return put(plant, j, gap=p["gap"])

    return _planted("backlash", robot, j, lambda s: {"gap": s * scale.reach[j]}, law, start=0.01, most=0.2)


def compliance(robot: Robot, scale: Scale, j: int, _: Rng) -> Effect | None:
    if not robot.rotor[j]:
        return None

    def law(plant, p):
        return put(plant, j, stiff=p["stiffness"])

    unit = scale.torque[j] / scale.reach[j]
    return _planted("transmission_compliance", robot, j, lambda s: {"stiffness": unit / s}, law, start=0.01, most=0.1)


def coupling(robot: Robot, scale: Scale, j: int, rng: Rng) -> Effect:
    i = min(j, len(robot.names) - 2)
    ratio = float(rng.choice((-1.0, 1.0)) * rng.choice((0.5, 1.0)))
    unit, slope = min(scale.torque[i : i + 2]), rng.uniform(0.2, 0.8)
    inertia = rng.uniform(0.0, 0.3) * min(scale.inertia[i : i + 2])

    def parameters(s):
        speed = max(scale.speed[i : i + 2])
        return {
            "ratio": ratio,
            "coulomb_torque": s * unit,
            "coefficient": slope * s * unit / speed,
            "inertia": inertia * min(s, 1.0),
        }

    def kept(world, s):
        p = parameters(s)
        row = [i, i + 1, p["ratio"], p["coulomb_torque"], p["coefficient"], p["inertia"]]
        return replace(world, plant=world.plant._replace(couple=np.array(row, dtype=float)))

    return Effect("joint_coupling", f"{robot.names[i]}+{robot.names[i + 1]}", kept, parameters, 0.1)


def cogging(robot: Robot, scale: Scale, j: int, rng: Rng) -> Effect:
    # At least a dozen cycles within the motion, else nobody can see a period.
    first = int(np.ceil(12.0 * np.pi / scale.reach[j])) + int(rng.integers(0, 5))
    orders = [first] if rng.random() < 0.6 else [first, 2 * first]
    phases = [float(x) for x in rng.uniform(-np.pi, np.pi, len(orders))]
    shares = [1.0, 0.5][: len(orders)]

    def parameters(s):
        return {"order": orders, "amplitude": [s * scale.torque[j] * x for x in shares], "phase": phases}

    def kept(world, s):
        p, filled = parameters(s), {}
        for field, name in (("orders", "order"), ("heights", "amplitude"), ("phases", "phase")):
            values = getattr(world.plant, field).copy()
            values[j] = [*p[name], *[0.0] * (ORDERS - len(orders))]
            filled[field] = values
        return replace(world, plant=world.plant._replace(**filled))

    return Effect("cogging", robot.names[j], kept, parameters, 0.1)


def saturation(robot: Robot, scale: Scale, j: int, _: Rng) -> Effect:
    def law(plant, p):
        return put(plant, j, limit=p["limit"])

    return _planted(
        "torque_saturation", robot, j, lambda s: {"limit": (1.0 - s) * scale.most[j]}, law, start=0.1, most=0.6
    )


def torque_constant(robot: Robot, _scale: Scale, j: int, rng: Rng) -> Effect:
    side = rng.choice((-1.0, 1.0))

    def law(plant, p):
        return put(plant, j, ratio=p["ratio"])

    return _planted("torque_constant", robot, j, lambda s: {"ratio": 1.0 + side * s}, law, start=0.2, most=0.45)


def torque_offset(robot: Robot, scale: Scale, j: int, rng: Rng) -> Effect:
    side = rng.choice((-1.0, 1.0))

    def law(plant, p):
        return put(plant, j, offset=p["torque"])

    return _planted("torque_offset", robot, j, lambda s: {"torque": side * s * scale.torque[j]}, law, start=0.1)


def _late(name: str, key: str, field: str, most: float) -> Law:
    """Delay or lag, of one drive or of all."""

    def drawn(robot: Robot, _scale: Scale, j: int, rng: Rng) -> Effect:
        common = len(robot.names) > 1 and rng.random() < 0.5

        def kept(world: World, s: float) -> World:
            values = getattr(world.plant, field).copy()
            values[slice(None) if common else j] = s
            return replace(world, plant=world.plant._replace(**{field: values}))

        return Effect(name, None if common else robot.names[j], kept, lambda s: {key: s}, 0.004, most)

    return drawn


input_delay = _late("input_delay", "delay", "delay", 0.03)
actuator_lag = _late("actuator_lag", "time_constant", "lag", 0.04)


def rotor(robot: Robot, scale: Scale, j: int, _: Rng) -> Effect:
    def law(plant, p):
        return add(plant, j, rotor=p["inertia"])

    return _planted("rotor_inertia", robot, j, lambda s: {"inertia": s * scale.inertia[j]}, law, start=0.2, most=5.0)


def payload(robot: Robot, _scale: Scale, _j: int, rng: Rng) -> Effect:
    last = len(robot.names) - 1
    heavy, box = robot.given.mass[last], np.array(robot.kind.joints[last].size)
    center = robot.given.center[last] + box * rng.uniform(-0.4, 0.4, 3)

    def parameters(s):
        return {"mass": s * heavy, **{f"center_{x}": float(c) for x, c in zip("xyz", center, strict=True)}}

    def kept(world, s):
        small = s * heavy * 0.4 * 0.03**2 * np.eye(3)  # a ball of 3 cm
        return replace(world, chain=with_body(world.chain, last, s * heavy, center, small))

    return Effect("payload", None, kept, parameters, 0.4, 6.0)


def inertias(robot: Robot, _scale: Scale, j: int, rng: Rng) -> Effect:
    side, box = rng.choice((-1.0, 1.0)), np.array(robot.kind.joints[j].size)
    way = 0.3 * box * rng.uniform(-1.0, 1.0, 3)

    def parameters(s):
        return {
            "mass_ratio": 1.0 + side * s,
            "inertia_ratio": 1.0 + side * s,
            "center_shift": [float(s * x) for x in way],
        }

    def kept(world, s):
        factor = 1.0 + side * s
        return replace(world, chain=with_link(world.chain, j, factor, s * way, factor))

    return Effect("inertial_parameters", robot.names[j], kept, parameters, 0.4, 0.8 if side < 0 else 3.0)


def tilt(_robot: Robot, _scale: Scale, _j: int, rng: Rng) -> Effect:
    angle = rng.uniform(-np.pi, np.pi)
    way = np.array([np.cos(angle), np.sin(angle), 0.0])

    def parameters(s):
        return {name: float(s * x) for name, x in zip(("roll", "pitch", "yaw"), way, strict=True)}

    return Effect(
        "base_tilt", None, lambda world, s: replace(world, chain=tilted(world.chain, s * way)), parameters, 0.04, 0.35
    )


def spring(robot: Robot, scale: Scale, j: int, rng: Rng) -> Effect:
    rest = scale.middle[j] + scale.reach[j] * rng.uniform(-1.0, 1.0)

    def law(plant, p):
        return put(plant, j, spring=p["stiffness"], rest=p["rest_position"])

    unit = scale.torque[j] / scale.reach[j]
    return _planted(
        "parasitic_spring", robot, j, lambda s: {"stiffness": s * unit, "rest_position": rest}, law, start=0.1
    )


def encoder_offset(robot: Robot, _scale: Scale, j: int, rng: Rng) -> Effect:
    side = rng.choice((-1.0, 1.0))

    def law(plant, p):
        return put(plant, j, shift=p["offset"])

    return _planted("encoder_offset", robot, j, lambda s: {"offset": side * s}, law, start=0.04, most=0.35)


def eccentricity(robot: Robot, _scale: Scale, j: int, rng: Rng) -> Effect:
    phase, order = float(rng.uniform(-np.pi, np.pi)), int(rng.choice((1, 1, 2)))

    def law(plant, p):
        return put(plant, j, wave=p["amplitude"], wave_phase=p["phase"], wave_order=p["order"])

    return _planted(
        "encoder_eccentricity",
        robot,
        j,
        lambda s: {"amplitude": s, "phase": phase, "order": order},
        law,
        start=0.03,
        most=0.3,
    )


def coarse(robot: Robot, scale: Scale, j: int, _: Rng) -> Effect:
    unit = 0.01 * scale.reach[j]

    def kept(world, s):
        steps = world.quantum.copy()
        steps[j] = max(steps[j], s * unit)
        return replace(world, quantum=steps)

    return Effect("encoder_quantization", robot.names[j], kept, lambda s: {"step": s * unit}, 0.2, 3.0)


EFFECTS: tuple[Law, ...] = (
    viscous,
    coulomb,
    by_direction,
    stribeck,
    presliding,
    loaded,
    backlash,
    compliance,
    coupling,
    cogging,
    saturation,
    torque_constant,
    torque_offset,
    input_delay,
    actuator_lag,
    rotor,
    payload,
    inertias,
    tilt,
    spring,
    encoder_offset,
    eccentricity,
    coarse,
)
TURNING_ONLY = (cogging, encoder_offset, eccentricity, coarse)  # a linear axis has no revolution, or hides it
OF_COMMANDS = (input_delay, actuator_lag, saturation)  # a measured current already has them
