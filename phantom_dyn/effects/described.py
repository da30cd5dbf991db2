"""How an effect is described: in words for reports, and in numbers for model files and control laws."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from phantom_dyn.array_types import Float
from phantom_dyn.model.robot import Robot

# What a residual may be drawn over.
Variable = Literal[
    "velocity",
    "position",
    "displacement",
    "transmitted",
    "acceleration",
    "torque_rate",
    "torque_curvature",
    "time",
    "phase",
    "coupled_velocity",
    "measured",
    "modelled",
]
ANY_VARIABLE: tuple[Variable, ...] = (
    "velocity",
    "position",
    "displacement",
    "transmitted",
    "acceleration",
    "torque_rate",
    "time",
)


@dataclass(frozen=True)
class EffectWords:
    """Words for an effect, for a reader who knows the robot but not statistics.

    Attributes:
        name: A noun that "on joint j2" can follow.
        meaning: Description of the effect, a phrase.
        next_step: Advice on the next step, a sentence.
        less: Name when the first parameter is negative, where that has a meaning of its own.
        size: Phrase after the name that states its size, such as ``of {torque}``; a field is a parameter.
        parameters: Meaning of each parameter, where its name does not give it already.
        shown_over: Variables that its law depends on, the likeliest first; of several the data choose.
        separated_by: What distinguishes it from effects that leave the same torque in every motion.
        kept: The part of it that a model file can express, after "It has, "; empty if that is all of it or none.
        lost: The part that a model file cannot express; the name if empty.
    """

    name: str
    meaning: str
    next_step: str
    less: str = ""
    size: str = ""
    parameters: Mapping[str, str] = field(default_factory=dict)
    shown_over: tuple[Variable, ...] = ANY_VARIABLE
    separated_by: Literal["weighing", "data sheet", "link encoder", "level", "timing"] | None = None
    kept: str = ""
    lost: str = ""


@dataclass(frozen=True)
class FormulaTerm:
    """A column of an effect as a term of a formula for torque that no effect explains.

    Attributes:
        kind: Its kind in words; terms of one kind can replace each other.
        text: The term as a function of the inputs, such as ``|tl|*sign(v)``.
        column: The same as a function. Its arguments are the inputs that it needs, by their names: ``q``, ``v`` and
            ``a`` of the joint, ``tl`` (torque that the transmission passes), ``temp`` (temperature of the drive).
        per: Unit that divides that of the torque, with ``{angle}``, ``{speed}`` and ``{torque}`` for the units of
            the joint; empty if the coefficient is a torque.
    """

    kind: str
    text: str
    column: Callable[..., Float[np.ndarray, " N"]]
    per: str = ""


def less(name: str, value: float) -> str:
    """Text of a difference, as in ``(q - 0.3)``."""
    return f"({name} {'+' if value < 0 else '-'} {abs(value):.3g})"


@dataclass(frozen=True)
class Coupling:
    """Friction and inertia that move with ``v_first + ratio v_second``, from `joint_coupling`."""

    first: str
    second: str
    ratio: float
    coulomb_torque: float
    coefficient: float
    inertia: float


@dataclass(frozen=True)
class ModelNumbers:
    """One effect in the numbers that model files and control laws can express; SI units on the joint side.

    Attributes:
        whole: True if they express all of the effect.
        viscous: Viscous coefficient beyond the modelled one.
        coulomb: Coulomb torque beyond the modelled one.
        rotor_inertia: Rotor inertia beyond the modelled one.
        robot: Function that changes links or gravity of a robot.
        turned: Rotation of gravity in the base frame, ``(3, 3)``.
        offset: Constant torque, positive along the joint.
        spring: Stiffness and rest position.
        gain: True torque over logged torque.
        limit: Largest torque of the drive.
        delay: Time [s] by which the drive is late.
        lag: Time constant [s] of the drive.
        reference_delay: Time [s] by which references of a position controller arrive late.
        gap: Full width of backlash.
        stiffness: Stiffness of the transmission.
        waves: Order, amplitude and phase of each wave of a torque over position.
        coupling: Coupling of two joints.
        zero: Reading of the encoder less the true position.
    """

    whole: bool = False
    viscous: float = 0.0
    coulomb: float = 0.0
    rotor_inertia: float = 0.0
    robot: Callable[[Robot], Robot] | None = None
    turned: Float[np.ndarray, "3 3"] | None = None
    offset: float | None = None
    spring: tuple[float, float] | None = None
    gain: float | None = None
    limit: float | None = None
    delay: float | None = None
    lag: float | None = None
    reference_delay: float | None = None
    gap: float | None = None
    stiffness: float | None = None
    waves: tuple[tuple[float, float, float], ...] = ()
    coupling: Coupling | None = None
    zero: float | None = None
