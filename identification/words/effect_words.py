"""The catalogue of effects and the regimes in plain words, for a reader who knows the robot but not statistics."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class EffectWords:
    """An effect in words.

    Attributes:
        name: As in "... on joint j2".
        meaning: What it is, a phrase.
        next_step: What to do about it, a sentence.
        less: Name when the first parameter is negative, where that has a meaning of its own.
    """

    name: str
    meaning: str
    next_step: str
    less: str = ""


EFFECTS: dict[str, EffectWords] = {
    "viscous_friction": EffectWords(
        "viscous friction",
        "friction torque that grows in proportion to speed",
        "Add the coefficient to the joint's damping in the model, and record once cold and once warm: "
        "it changes with the lubricant's temperature.",
        "less viscous friction than modelled",
    ),
    "coulomb_friction": EffectWords(
        "Coulomb friction",
        "friction torque of constant size that opposes the motion",
        "Add the torque to the joint's friction in the model; slow reversals in several postures confirm it.",
        "less Coulomb friction than modelled",
    ),
    "direction_dependent_friction": EffectWords(
        "direction-dependent friction",
        "friction that is larger in one direction than in the other",
        "Put both directions into the model, and look at the drive for a cause that prefers one direction "
        "(cable, seal, amplifier offset).",
        "less friction than modelled, by direction",
    ),
    "stribeck_friction": EffectWords(
        "Stribeck friction",
        "friction that falls as the joint starts to move and then levels off",
        "Record at least five slow constant speeds in both directions to fix the curve, then put it into the model.",
    ),
    "presliding_friction": EffectWords(
        "presliding friction",
        "friction that builds up over a small displacement after each reversal, like a spring that lets go",
        "Record reversals at three or more accelerations, then use a bristle model in the simulation.",
    ),
    "load_dependent_friction": EffectWords(
        "load-dependent friction",
        "friction that grows with the torque that the transmission passes on",
        "Record the same motion with two payloads, then scale the joint's friction with the load in the model.",
        "less load-dependent friction than modelled",
    ),
    "backlash": EffectWords(
        "backlash",
        "play in the transmission: the link is loose over a small angle",
        "Check the play by hand with the motor held, tighten or preload the transmission, or model the play.",
    ),
    "transmission_compliance": EffectWords(
        "transmission compliance",
        "the transmission gives like a spring between motor and link",
        "Compare the stiffness with the data sheet of gear, belt or cable, and model the joint as elastic.",
    ),
    "joint_coupling": EffectWords(
        "joint coupling",
        "friction or inertia that acts when both joints move, as in a coupled transmission",
        "Record the two joints moving in phase, then out of phase, and model the coupled transmission.",
    ),
    "cogging": EffectWords(
        "cogging",
        "torque that repeats with the joint angle, the same at every speed",
        "Record at several slow speeds over at least one period, then compensate it with a table over the angle.",
    ),
    "torque_saturation": EffectWords(
        "torque saturation",
        "the drive gives less than what is commanded beyond a limit",
        "Put the limit into the robot's configuration, and repeat the recording below it.",
    ),
    "torque_constant": EffectWords(
        "a wrong torque constant",
        "the true torque is a fixed multiple of the one that is recorded",
        "Multiply the torque constant by the ratio; a known weight at a known distance checks it.",
    ),
    "torque_offset": EffectWords(
        "a torque offset",
        "a constant torque that is there in every posture and at every speed",
        "Check the zero of the torque sensor or amplifier, and the balance of the joint.",
    ),
    "input_delay": EffectWords(
        "an input delay",
        "the torque acts later than it is recorded",
        "Check time stamps and bus cycles, and put the delay into the simulation; record with two controller "
        "gains to part it from friction.",
    ),
    "actuator_lag": EffectWords(
        "actuator lag",
        "the torque follows its command like a first-order low pass",
        "Check the bandwidth of the current loop, and put the lag into the simulation.",
    ),
    "rotor_inertia": EffectWords(
        "rotor inertia",
        "inertia of motor and gear that acts on this joint alone",
        "Add it to the joint's rotor inertia (armature), and compare with the data sheet: rotor inertia times gear "
        "ratio squared.",
        "less rotor inertia than modelled",
    ),
    "payload": EffectWords(
        "a payload",
        "a mass on the last link that the model does not carry",
        "Weigh the tool, cable or load at the last link, and add it to the model.",
        "less mass on the last link than modelled",
    ),
    "inertial_parameters": EffectWords(
        "wrong inertial parameters",
        "masses, centres of mass or inertias of the links beyond what the model's tolerance allows",
        "Identify the inertias with an exciting motion, and replace those of the model.",
    ),
    "base_tilt": EffectWords(
        "a tilted base",
        "gravity has another direction than in the model",
        "Put a level on the base, correct the mounting or the model's gravity.",
    ),
    "parasitic_spring": EffectWords(
        "a parasitic spring",
        "a torque that pulls the joint towards one position, as a cable or hose does",
        "Look for cables and hoses at this joint; reroute them or model the spring.",
    ),
    "encoder_offset": EffectWords(
        "an encoder offset",
        "the position is read with a constant error",
        "Calibrate the joint's zero again, and correct the offset.",
    ),
    "encoder_eccentricity": EffectWords(
        "encoder eccentricity",
        "the position is read with an error that repeats with each turn",
        "Check how the encoder disc is centred, or correct the reading with a table over the angle.",
    ),
    "encoder_quantization": EffectWords(
        "coarse encoder steps",
        "the position is rounded to a step coarser than stated",
        "Check the encoder's resolution and the number format of the log, and state the true counts.",
    ),
}

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
    plain = effect.replace("_", " ")
    return EFFECTS.get(effect) or EffectWords(plain, plain, "See what this effect means in its documentation.")


def regime_words(regime: str | None) -> str:
    """Words for a regime; empty for None."""
    return "" if regime is None else REGIMES.get(regime, regime.replace("_", " "))
