"""What the author of an effect imports, in one place; `docs/how_to/own_effects.md` shows how."""

from phantom_dyn.effects.described import EffectWords, ModelNumbers
from phantom_dyn.effects.effect import Effect, Parameter
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.rival import Shape, Signature, SpecialCase
from phantom_dyn.effects.simulated import Moment, Simulated, Transmission
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
from phantom_dyn.effects.user.law_effect import LawEffect
from phantom_dyn.model.robot import Robot

__all__ = [
    "Effect",
    "EffectWords",
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
    "Transmission",
    "damping_unit",
    "inertia_unit",
    "on_one_joint",
    "row_of",
    "stiffness_unit",
    "torque_on_joint",
    "torque_unit",
    "velocity_unit",
]
