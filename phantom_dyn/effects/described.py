"""How an effect describes itself: in words for reports, and in numbers for model files and control laws."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from phantom_dyn.array_types import Float
from phantom_dyn.model.robot import Robot

# Quantities over which a report may draw a residual.
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
        meaning: A phrase that describes the effect.
        next_step: A sentence with the recommended next step.
        less: Name to use instead of ``name`` if the first parameter is negative; empty for the same name.
        size: A phrase that follows the name and states the size; it has names of parameters in braces, as in
            ``of {torque}``.
        parameters: Meaning of each parameter whose name does not say it.
        shown_over: Quantities on which the law depends, the likeliest first. A report draws the residual over one of
            them, which it chooses by the data.
        separated_by: What distinguishes the effect from other effects that have the same torque in every motion.
        kept: The part of the effect that a model file can express, as a phrase that follows "It has, "; empty if a
            model file can express all of the effect or nothing.
        lost: The part that a model file cannot express, in words; empty if ``name`` is the right word for this part.
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
    """A term that an effect contributes to the library of formulas, for a residual that no effect explains.

    Attributes:
        kind: Kind of the term in words; terms of one kind can replace each other.
        text: The term in writing, such as ``|tl|*sign(v)``.
        column: Function that computes the term. Its arguments are named after the inputs that it needs: ``q``, ``v``
            and ``a`` of the joint, ``tl`` (torque that the transmission passes), ``temp`` (temperature of the drive).
        per: Unit of the term: the unit of its coefficient is a torque unit over it. ``{angle}``, ``{speed}`` and
            ``{torque}`` are replaced by the units of the joint; empty for a term without a unit.
    """

    kind: str
    text: str
    column: Callable[..., Float[np.ndarray, " N"]]
    per: str = ""


def less(name: str, value: float) -> str:
    """Text of ``name`` minus ``value``, as in ``(q - 0.3)``."""
    return f"({name} {'+' if value < 0 else '-'} {abs(value):.3g})"


@dataclass(frozen=True)
class Coupling:
    """Friction and inertia of a part that moves with ``v_first + ratio v_second``, from `joint_coupling`."""

    first: str
    second: str
    ratio: float
    coulomb_torque: float
    coefficient: float
    inertia: float


@dataclass(frozen=True)
class ModelNumbers:
    """Numbers by which model files and control laws express one effect; SI units on the joint side of the gear.

    Attributes:
        whole: True if the numbers express all of the effect.
        viscous: Viscous coefficient in addition to the modelled one.
        coulomb: Coulomb torque in addition to the modelled one.
        rotor_inertia: Rotor inertia in addition to the modelled one.
        robot: Function that returns a robot with changed links or gravity.
        turned: Rotation matrix of gravity in the base frame, ``(3, 3)``.
        offset: Constant torque, positive in the positive direction of the joint.
        spring: Stiffness and rest position of a spring on the joint.
        gain: True torque over logged torque.
        limit: Largest torque of the drive.
        delay: Delay [s] of the drive.
        lag: Time constant [s] of the drive.
        reference_delay: Delay [s] of the references of a position controller.
        gap: Full width of backlash.
        stiffness: Stiffness of the transmission.
        waves: Order, amplitude and phase of each wave of a torque that is periodic in position.
        coupling: Coupling of two joints.
        zero: Reading of the encoder minus the true position.
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
