"""All names that the file of an effect imports; `docs/how_to/own_effects.md` shows how to write an effect."""

from phantom_dyn.array_types import Array, Float
from phantom_dyn.effects.described import EffectWords, FormulaTerm, ModelNumbers
from phantom_dyn.effects.effect import Effect, Parameter, Stated
from phantom_dyn.effects.law_effect import LawEffect
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.rival import Shape, Signature, SpecialCase
from phantom_dyn.effects.simulated import Law, Moment, Simulated, Transmission, command_law, reading_law, torque_law
from phantom_dyn.effects.support.rows import (
    damping_unit,
    inertia_unit,
    on_one_joint,
    row_of,
    stiffness_unit,
    torque_on_joint,
    torque_unit,
    velocity_unit,
)
from phantom_dyn.model.robot import Robot

__all__ = [
    "Array",
    "Effect",
    "EffectWords",
    "Float",
    "FormulaTerm",
    "Law",
    "LawEffect",
    "ModelNumbers",
    "Moment",
    "Operation",
    "Parameter",
    "Robot",
    "Shape",
    "Signature",
    "Simulated",
    "SpecialCase",
    "Stated",
    "Transmission",
    "command_law",
    "damping_unit",
    "inertia_unit",
    "on_one_joint",
    "reading_law",
    "row_of",
    "stiffness_unit",
    "torque_law",
    "torque_on_joint",
    "torque_unit",
    "velocity_unit",
]
