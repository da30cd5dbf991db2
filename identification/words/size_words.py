"""How large an effect is, in words: one phrase for the sentence of a finding, and what each parameter means."""

from __future__ import annotations

import math
import string

from identification.diagnosis.result import Finding, Value
from identification.words.numbers import NO_BREAK, number, value_words, with_unit

# What follows the name of an effect; a field is a parameter of the contract.
SIZES: dict[str, str] = {
    "viscous_friction": "of {coefficient}",
    "coulomb_friction": "of {torque}",
    "direction_dependent_friction": "of {torque_positive} forward and {torque_negative} backward",
    "stribeck_friction": "that falls from {static_torque} to {coulomb_torque}",
    "presliding_friction": "of {torque}, built up over {displacement}",
    "load_dependent_friction": "of {ratio} times the load",
    "backlash": "of {gap}",
    "transmission_compliance": "with a stiffness of {stiffness}",
    "joint_coupling": "through the first joint's velocity plus {ratio} times the second's",
    "cogging": "of {amplitude}, {order} times a turn",
    "torque_saturation": "at {limit}",
    "torque_constant": ": the true torque is {ratio} times the recorded one",
    "torque_offset": "of {torque}",
    "input_delay": "of {delay}",
    "actuator_lag": "with a time constant of {time_constant}",
    "rotor_inertia": "of {inertia}",
    "payload": "of {mass}",
    "inertial_parameters": "",
    "base_tilt": "of {roll} about x and {pitch} about y",
    "parasitic_spring": "of {stiffness}, at rest at {rest_position}",
    "encoder_offset": "of {offset}",
    "encoder_eccentricity": "of {amplitude}",
    "encoder_quantization": "of {step}",
}

# What a parameter means, where its name does not say it already.
PARAMETERS: dict[str, dict[str, str]] = {
    "viscous_friction": {"coefficient": "friction torque per unit of speed"},
    "coulomb_friction": {"torque": "friction torque at any speed"},
    "direction_dependent_friction": {
        "torque_positive": "constant friction torque in the positive direction",
        "torque_negative": "constant friction torque in the negative direction",
        "coefficient_positive": "friction torque per unit of speed in the positive direction",
        "coefficient_negative": "friction torque per unit of speed in the negative direction",
    },
    "stribeck_friction": {
        "coulomb_torque": "friction torque at speed",
        "static_torque": "friction torque as the motion begins",
        "stribeck_velocity": "speed at which about a third of the difference is left",
    },
    "presliding_friction": {
        "torque": "friction torque once the joint slides",
        "displacement": "way after a reversal over which friction builds up",
        "static_ratio": "friction torque at rest over that while sliding",
        "stick_velocity": "speed below which the joint sticks",
    },
    "load_dependent_friction": {"ratio": "friction torque per torque that the transmission passes on"},
    "backlash": {"gap": "full width of the play, on the joint side"},
    "transmission_compliance": {"stiffness": "torque per deflection between motor and link"},
    "joint_coupling": {
        "ratio": "how much the second joint's speed counts against the first's",
        "coulomb_torque": "constant friction torque of the coupled motion",
        "coefficient": "friction torque per unit of coupled speed",
        "inertia": "inertia that moves with the coupled speed",
    },
    "cogging": {
        "order": "periods in one turn of the joint",
        "amplitude": "largest torque of each order",
        "phase": "phase of each order at joint angle zero",
    },
    "torque_saturation": {"limit": "torque beyond which the drive gives no more"},
    "torque_constant": {"ratio": "true torque over recorded torque"},
    "torque_offset": {"torque": "constant torque along the joint's positive direction"},
    "input_delay": {"delay": "time from the recorded to the acting torque"},
    "actuator_lag": {"time_constant": "time after which a step of torque has come to 63 %"},
    "rotor_inertia": {"inertia": "inertia of motor and gear on the joint side"},
    "payload": {
        "mass": "additional mass",
        "center_x": "its place along x of the frame that carries it",
        "center_y": "its place along y",
        "center_z": "its place along z",
    },
    "base_tilt": {
        "roll": "turn of gravity about x of the base",
        "pitch": "turn of gravity about y of the base",
    },
    "parasitic_spring": {
        "stiffness": "torque per displacement",
        "rest_position": "position at which it pulls to neither side",
    },
    "encoder_offset": {"offset": "reading less true position"},
    "encoder_eccentricity": {
        "amplitude": "largest error of the reading",
        "phase": "phase of the error at position zero",
        "order": "periods of the error in one turn",
    },
    "encoder_quantization": {"step": "distance between two readings"},
}

# Of a body, in the frame of the joint that moves it; a name is BODY.QUANTITY.
INERTIAL: dict[str, str] = {
    "m": "mass",
    **{f"m{a}": f"mass times the place of its centre along {a}" for a in "xyz"},
    **{f"I{a}{a}": f"moment of inertia about {a}" for a in "xyz"},
    **{f"I{a}{b}": f"product of inertia in {a} and {b}" for a, b in ("xy", "xz", "yz")},
}


def size_words(finding: Finding) -> str:
    """What follows a finding's name, as in ``of 0.051 N m``; empty where a parameter is missing."""
    template = SIZES.get(finding.effect, "")
    fields = [name for _, name, _, _ in string.Formatter().parse(template) if name]
    if not fields or any(name not in finding.parameters for name in fields):
        return ""
    return template.format(**{name: _shown(finding.parameters[name]) for name in fields})


def shortfall_words(value: Value) -> str:
    """What follows the name of a finding that says there is less than modelled, as in ``by 0.051 N m``."""
    return f"by {with_unit(number(abs(_listed(value)[0])), value.unit)}"


def meaning_of(effect: str, parameter: str) -> str:
    """What a parameter of an effect means; empty where its name says it."""
    _, dot, quantity = parameter.rpartition(".")
    return INERTIAL.get(quantity, "") if dot else PARAMETERS.get(effect, {}).get(parameter, "")


def value_cell(value: Value) -> str:
    """A value for a table; a single angle in degrees as well."""
    shown = value_words(value).replace(" ", NO_BREAK).replace(f",{NO_BREAK}", ", ")
    if value.unit != "rad" or isinstance(value.value, list) or not math.isfinite(value.value):
        return shown
    return f"{shown}{NO_BREAK}({number(math.degrees(value.value))}°)"


def _shown(value: Value) -> str:
    """A value in a sentence, without its deviation: that is in the table of sizes."""
    return with_unit(" and ".join(number(v) for v in _listed(value)), value.unit)


def _listed(value: Value) -> list[float]:
    return value.value if isinstance(value.value, list) else [value.value]
