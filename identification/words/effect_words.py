"""Effects and regimes in plain words: those that an effect carries, for any name."""

from __future__ import annotations

from phantom_dyn.effects.catalogue import known_effect
from phantom_dyn.effects.described import EffectWords

# Reports list these first, in the contract's order (friction, transmission, drive, load, encoder); others follow.
_FIRST = (
    "viscous_friction",
    "coulomb_friction",
    "direction_dependent_friction",
    "stribeck_friction",
    "presliding_friction",
    "load_dependent_friction",
    "backlash",
    "transmission_compliance",
    "joint_coupling",
    "cogging",
    "torque_saturation",
    "torque_constant",
    "torque_offset",
    "input_delay",
    "actuator_lag",
    "rotor_inertia",
    "payload",
    "inertial_parameters",
    "base_tilt",
    "parasitic_spring",
    "encoder_offset",
    "encoder_eccentricity",
    "encoder_quantization",
)

REGIMES: dict[str, str] = {
    "velocity_reversal": "where the velocity changes sign",
    "low_speed": "at low speed",
    "high_speed": "at high speed",
    "high_load": "under high load",
    "high_acceleration": "at high acceleration",
    "one_direction": "in one direction of motion",
    "periodic_in_angle": "repeating with the joint angle",
    "posture": "in some postures more than in others",
    "saturated": "where the torque is at its limit",
    "time_drift": "drifting over time",
    "everywhere": "throughout the motion",
}


def effect_words(effect: str) -> EffectWords:
    """Words for an effect of the catalogue; a name from elsewhere is shown as it is."""
    known = known_effect(effect)
    if known is not None:
        return known.words
    plain = effect.replace("_", " ")
    return EffectWords(plain, plain, "See what this effect means in its documentation.")


def report_order(effect: str) -> int:
    """Place of an effect in lists of a report."""
    return _FIRST.index(effect) if effect in _FIRST else len(_FIRST)


def is_between_joints(effect: str) -> bool:
    """True if an effect of the catalogue sits between two joints."""
    known = known_effect(effect)
    return known is not None and known.scope == "pair"


def regime_words(regime: str | None) -> str:
    """Words for a regime; empty for None."""
    return "" if regime is None else REGIMES.get(regime, regime.replace("_", " "))
