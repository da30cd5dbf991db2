"""A size of any effect of the catalogue, for tests that put each of them into a robot."""

import numpy as np

from phantom_dyn.effects.effect import Effect
from phantom_dyn.model.robot import Robot

CONTRACT_SIZES = {
    "viscous_friction": [0.5],
    "coulomb_friction": [0.3],
    "direction_dependent_friction": [0.5, 0.2, 0.1, 0.3],
    "stribeck_friction": [0.2, 0.6, 0.4],
    "torque_offset": [0.4],
    "torque_constant": [0.8],
    "rotor_inertia": [0.05],
    "payload": [0.4, 0.02, 0.0, -0.3],
    "inertial_parameters": [0.1, 0.02, 0.0, -0.03, 0.01, 0.0, 0.01, 0.0, 0.0, 0.01],
    "parasitic_spring": [3.0, 0.2],
    "presliding_friction": [0.6, 0.02],
    "load_dependent_friction": [0.1],
    "position_dependent_friction": [-0.3, 0.1, 0.4, 0.2, 0.5, 0.1],
    "temperature_dependent_friction": [0.3, 0.5, -0.01, -0.02, 30.0],
    "joint_coupling": [-0.7, 0.3, 0.2, 0.05],
    "cogging": [3.0, 7.0, 0.3, 0.2, 0.1, 1.0],
    "torque_ripple": [3.0, 7.0, 0.1, 0.05, 0.1, 1.0],
    "torque_saturation": [2.0],
    "input_delay": [0.0117],
    "actuator_lag": [0.01],
    "backlash": [0.02],
    "transmission_compliance": [300.0],
    "base_tilt": [0.02, -0.05, 0.0],
    "encoder_offset": [0.03],
    "encoder_eccentricity": [0.02, 0.4, 1.0],
    "encoder_quantization": [0.01],
}
"""Parameters of the effects of the contract, on one joint or on the whole robot; of others see `sample_size`."""


def sample_size(effect: Effect, robot: Robot, joint: str | None) -> dict[str, float]:
    """A third of a unit of each parameter, or as much of it as a sound device may have."""
    out = {}
    for one in effect.parameters(robot, joint):
        low, high = (one.lower, one.upper) if one.plausible is None else one.plausible
        out[one.name] = float(np.clip(1.0 / 3.0, low, high))
    return out
