"""The list of all effects: named causes of a gap between robot and model. A new effect needs a file and a line here.

Effects that a user defines for one run are stored in the `Robot`, see `phantom_dyn.effects.user.user_effects`.
"""

from __future__ import annotations

from typing import cast

from phantom_dyn.effects.drive.actuator_lag import ActuatorLag
from phantom_dyn.effects.drive.cogging import Cogging
from phantom_dyn.effects.drive.input_delay import InputDelay
from phantom_dyn.effects.drive.reference_delay import ReferenceDelay
from phantom_dyn.effects.drive.rotor_inertia import RotorInertia
from phantom_dyn.effects.drive.torque_constant import TorqueConstant
from phantom_dyn.effects.drive.torque_offset import TorqueOffset
from phantom_dyn.effects.drive.torque_ripple import TorqueRipple
from phantom_dyn.effects.drive.torque_saturation import TorqueSaturation
from phantom_dyn.effects.effect import Effect
from phantom_dyn.effects.encoder.encoder_eccentricity import EncoderEccentricity
from phantom_dyn.effects.encoder.encoder_offset import EncoderOffset
from phantom_dyn.effects.encoder.encoder_quantization import EncoderQuantization
from phantom_dyn.effects.friction.coulomb_friction import CoulombFriction
from phantom_dyn.effects.friction.direction_dependent_friction import DirectionDependentFriction
from phantom_dyn.effects.friction.joint_coupling import JointCoupling
from phantom_dyn.effects.friction.load_dependent_friction import LoadDependentFriction
from phantom_dyn.effects.friction.position_dependent_friction import PositionDependentFriction
from phantom_dyn.effects.friction.presliding_friction import PreslidingFriction
from phantom_dyn.effects.friction.stribeck_friction import StribeckFriction
from phantom_dyn.effects.friction.temperature_dependent_friction import TemperatureDependentFriction
from phantom_dyn.effects.friction.viscous_friction import ViscousFriction
from phantom_dyn.effects.load.base_tilt import BaseTilt
from phantom_dyn.effects.load.inertial_parameters import InertialParameters
from phantom_dyn.effects.load.payload import Payload
from phantom_dyn.effects.transmission.backlash import Backlash
from phantom_dyn.effects.transmission.parasitic_spring import ParasiticSpring
from phantom_dyn.effects.transmission.transmission_compliance import TransmissionCompliance
from phantom_dyn.errors import ParameterError, known_names, shortened
from phantom_dyn.model.robot import Robot

EFFECTS: tuple[Effect, ...] = (
    ViscousFriction(),
    CoulombFriction(),
    DirectionDependentFriction(),
    StribeckFriction(),
    TorqueOffset(),
    TorqueConstant(),
    RotorInertia(),
    Payload(),
    InertialParameters(),
    ParasiticSpring(),
    PreslidingFriction(),
    LoadDependentFriction(),
    PositionDependentFriction(),
    TemperatureDependentFriction(),
    JointCoupling(),
    Cogging(),
    TorqueRipple(),
    TorqueSaturation(),
    InputDelay(),
    ActuatorLag(),
    ReferenceDelay(),
    Backlash(),
    TransmissionCompliance(),
    BaseTilt(),
    EncoderOffset(),
    EncoderEccentricity(),
    EncoderQuantization(),
)


def kind_and_place(name: str) -> tuple[str, int] | None:
    """Kind of an effect (the folder of its file) and its index in the catalogue; None for effects of a user."""
    index = next((index for index, effect in enumerate(EFFECTS) if effect.name == name), None)
    return None if index is None else (type(EFFECTS[index]).__module__.split(".")[-2], index)


def effects_of(robot: Robot) -> tuple[Effect, ...]:
    """All effects that the robot may have: those of the catalogue, then those that the user defined for it."""
    return (*EFFECTS, *cast("tuple[Effect, ...]", robot.user_effects))


def known_effect(name: str, robot: Robot | None = None) -> Effect | None:
    """The effect of this name in the catalogue or among the user's effects of the robot; None if there is none."""
    known = EFFECTS if robot is None else effects_of(robot)
    return next((effect for effect in known if effect.name == name), None)


def effect_named(name: str, robot: Robot | None = None) -> Effect:
    """The effect of this name in the catalogue or among the user's effects of the robot.

    Raises:
        ParameterError: If there is none; the message lists the known names.
    """
    effect = known_effect(name, robot)
    if effect is not None:
        return effect
    known = known_names(name, (effect.name for effect in (EFFECTS if robot is None else effects_of(robot))), "effects")
    own = "" if robot is None else " One of your own needs its file (--effects FILE.py)."
    raise ParameterError(f"Unknown effect {shortened(name)!r}: {known}{own}")
