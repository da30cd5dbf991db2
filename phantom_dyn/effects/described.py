"""Descriptions of an effect: in words for reports, and in numbers for model files and control laws."""

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
        next_step: A sentence that says what to do next.
        less: Name if the first parameter is negative, where the effect then has another name.
        size: A phrase after the name that states the size, such as ``of {torque}`` with the name of a parameter.
        parameters: Meaning of each parameter whose name does not say it.
        shown_over: Quantities on which the law depends, the likeliest first; the data decide between several.
        separated_by: What distinguishes the effect from effects that leave the same torque in every motion.
        kept: The part of the effect that a model file can express, a phrase after "It has, "; empty if a model file can
            express all or nothing.
        lost: The part that a model file cannot express; empty if the name says it.
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
    """A term that an effect offers to formulas of torque that no effect explains.

    Attributes:
        kind: Kind of the term in words; terms of one kind can replace each other.
        text: The term in writing, such as ``|tl|*sign(v)``.
        column: Function that computes the term. Its arguments are named after the inputs that it needs: ``q``, ``v``
            and ``a`` of the joint, ``tl`` (torque that the transmission passes), ``temp`` (temperature of the drive).
        per: The unit of the coefficient is that of a torque over this unit, with ``{angle}``, ``{speed}`` and
            ``{torque}`` for the units of the joint; empty if the coefficient is a torque.
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
        robot: Function that changes links or gravity of a robot.
        turned: Rotation of gravity in the base frame, ``(3, 3)``.
        offset: Constant torque, positive in the positive direction of the joint.
        spring: Stiffness and rest position.
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
