"""The one list of all effects; adding an effect touches its own file and this list."""

from __future__ import annotations

from phantom_dyn.effects.drive.actuator_lag import ActuatorLag
from phantom_dyn.effects.drive.cogging import Cogging
from phantom_dyn.effects.drive.input_delay import InputDelay
from phantom_dyn.effects.drive.rotor_inertia import RotorInertia
from phantom_dyn.effects.drive.torque_constant import TorqueConstant
from phantom_dyn.effects.drive.torque_offset import TorqueOffset
from phantom_dyn.effects.drive.torque_saturation import TorqueSaturation
from phantom_dyn.effects.effect import Effect
from phantom_dyn.effects.encoder.encoder_eccentricity import EncoderEccentricity
from phantom_dyn.effects.encoder.encoder_offset import EncoderOffset
from phantom_dyn.effects.encoder.encoder_quantization import EncoderQuantization
from phantom_dyn.effects.friction.coulomb_friction import CoulombFriction
from phantom_dyn.effects.friction.direction_dependent_friction import DirectionDependentFriction
from phantom_dyn.effects.friction.joint_coupling import JointCoupling
from phantom_dyn.effects.friction.load_dependent_friction import LoadDependentFriction
from phantom_dyn.effects.friction.presliding_friction import PreslidingFriction
from phantom_dyn.effects.friction.stribeck_friction import StribeckFriction
from phantom_dyn.effects.friction.viscous_friction import ViscousFriction
from phantom_dyn.effects.load.base_tilt import BaseTilt
from phantom_dyn.effects.load.inertial_parameters import InertialParameters
from phantom_dyn.effects.load.payload import Payload
from phantom_dyn.effects.transmission.backlash import Backlash
from phantom_dyn.effects.transmission.parasitic_spring import ParasiticSpring
from phantom_dyn.effects.transmission.transmission_compliance import TransmissionCompliance
from phantom_dyn.errors import ParameterError

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
    JointCoupling(),
    Cogging(),
    TorqueSaturation(),
    InputDelay(),
    ActuatorLag(),
    Backlash(),
    TransmissionCompliance(),
    BaseTilt(),
    EncoderOffset(),
    EncoderEccentricity(),
    EncoderQuantization(),
)


def known_effect(name: str) -> Effect | None:
    """The effect of that name; None if the catalogue has none."""
    return next((effect for effect in EFFECTS if effect.name == name), None)


def effect_named(name: str) -> Effect:
    """The effect of that name.

    Raises:
        ParameterError: If there is none; the text lists the known names.
    """
    effect = known_effect(name)
    if effect is not None:
        return effect
    known = ", ".join(effect.name for effect in EFFECTS)
    raise ParameterError(f"Unknown effect '{name}': known effects are {known}.")
