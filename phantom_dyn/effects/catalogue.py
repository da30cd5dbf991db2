"""The one list of all effects; adding an effect touches its own file and this list."""

from __future__ import annotations

from phantom_dyn.effects.actuator_lag import ActuatorLag
from phantom_dyn.effects.backlash import Backlash
from phantom_dyn.effects.base_tilt import BaseTilt
from phantom_dyn.effects.cogging import Cogging
from phantom_dyn.effects.coulomb_friction import CoulombFriction
from phantom_dyn.effects.direction_dependent_friction import DirectionDependentFriction
from phantom_dyn.effects.effect import Effect
from phantom_dyn.effects.encoder_eccentricity import EncoderEccentricity
from phantom_dyn.effects.encoder_offset import EncoderOffset
from phantom_dyn.effects.encoder_quantization import EncoderQuantization
from phantom_dyn.effects.inertial_parameters import InertialParameters
from phantom_dyn.effects.input_delay import InputDelay
from phantom_dyn.effects.joint_coupling import JointCoupling
from phantom_dyn.effects.load_dependent_friction import LoadDependentFriction
from phantom_dyn.effects.parasitic_spring import ParasiticSpring
from phantom_dyn.effects.payload import Payload
from phantom_dyn.effects.presliding_friction import PreslidingFriction
from phantom_dyn.effects.rotor_inertia import RotorInertia
from phantom_dyn.effects.stribeck_friction import StribeckFriction
from phantom_dyn.effects.torque_constant import TorqueConstant
from phantom_dyn.effects.torque_offset import TorqueOffset
from phantom_dyn.effects.torque_saturation import TorqueSaturation
from phantom_dyn.effects.transmission_compliance import TransmissionCompliance
from phantom_dyn.effects.viscous_friction import ViscousFriction
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


def effect_named(name: str) -> Effect:
    """The effect of that name.

    Raises:
        ParameterError: If there is none; the text lists the known names.
    """
    for effect in EFFECTS:
        if effect.name == name:
            return effect
    known = ", ".join(effect.name for effect in EFFECTS)
    raise ParameterError(f"Unknown effect '{name}': known effects are {known}.")
