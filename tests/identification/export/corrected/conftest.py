"""One case of every effect, and recordings of the planar arm with it."""

from collections.abc import Callable

import numpy as np
import pytest

from identification.diagnosis.columns.terms import KnownEffect
from identification.export.corrected.corrected_model import CorrectedModel, corrected_model
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.motion import Motion
from phantom_dyn.simulation.control import Tracking, position_control
from phantom_dyn.simulation.simulate import Cause, Simulation, simulate

CASES: dict[str, tuple[str | None, list[float]]] = {
    "viscous_friction": ("elbow", [0.5]),
    "coulomb_friction": ("elbow", [1.0]),
    "direction_dependent_friction": ("shoulder", [2.0, 1.0, 0.5, 0.2]),
    "stribeck_friction": ("elbow", [1.0, 1.5, 0.2]),
    "presliding_friction": ("elbow", [1.0, 0.01]),
    "load_dependent_friction": ("elbow", [0.2]),
    "position_dependent_friction": ("elbow", [-0.3, 0.3, 0.5, 1.5]),
    "temperature_dependent_friction": ("elbow", [1.0, 0.5, -0.02, -0.01, 40.0]),
    "torque_offset": ("elbow", [1.0]),
    "torque_constant": ("shoulder", [0.8]),
    "rotor_inertia": ("elbow", [0.1]),
    "payload": (None, [0.5, 0.02, 0.0, -0.4]),
    "inertial_parameters": ("elbow", [0.5, 0.02, 0.0, -0.2, 0.1, 0.0, 0.1, 0.0, 0.0, 0.01]),
    "parasitic_spring": ("elbow", [3.0, 0.2]),
    "joint_coupling": ("shoulder+elbow", [0.5, 0.6, 0.3, 0.05]),
    "cogging": ("elbow", [7.0, 14.0, 0.8, 0.3, 0.2, 1.0]),
    "torque_ripple": ("elbow", [7.0, 0.1, 0.2]),
    "torque_saturation": ("shoulder", [9.0]),
    "input_delay": (None, [0.008]),
    "actuator_lag": ("shoulder", [0.03]),
    "reference_delay": ("elbow", [0.02]),
    "backlash": ("elbow", [0.05]),
    "transmission_compliance": ("elbow", [60.0]),
    "base_tilt": (None, [0.1, 0.1, 0.0]),
    "encoder_offset": ("elbow", [0.1]),
    "encoder_eccentricity": ("elbow", [0.05, 0.3, 1.0]),
    "encoder_quantization": ("elbow", [0.01]),
}

KP, KD = np.array([400.0, 200.0]), np.array([40.0, 15.0])


@pytest.fixture(scope="session")
def case() -> Callable[[str], KnownEffect]:
    """One case of an effect by name."""
    return lambda name: KnownEffect(name, CASES[name][0], tuple(CASES[name][1]))


@pytest.fixture(scope="session")
def corrected(planar, case) -> Callable[..., CorrectedModel]:
    """The arm with some effects by name."""
    return lambda *names: corrected_model(planar, tuple(case(name) for name in names))


@pytest.fixture(scope="session")
def swing() -> Tracking:
    """Position control along two sines, sampled every 5 ms for five seconds."""
    t = np.arange(0, 5, 0.005)
    size, omega, phase = np.array([0.7, 0.9]), np.array([4.0, 6.5]), np.array([0.3, 1.2])
    angle = np.outer(t, omega) + phase
    return position_control(t, size * np.sin(angle), size * omega * np.cos(angle), kp=KP, kd=KD)


@pytest.fixture(scope="session")
def recorded(planar, swing) -> Callable[[str], Simulation]:
    """What a recording of the arm with one effect holds."""

    def run(name: str) -> Simulation:
        cause = Cause(effect_named(name), CASES[name][0], np.array(CASES[name][1]))
        return simulate(planar, (cause,), swing, swing.t, swing.q_ref[0], swing.v_ref[0])

    return run


@pytest.fixture(scope="session")
def some_motion() -> Motion:
    """Twenty unrelated samples."""
    return Motion(np.arange(20.0), *np.random.default_rng(0).standard_normal((3, 20, 2)))
