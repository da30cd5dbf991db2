"""What model files can hold of an effect. Oracle: the law of each effect in its module, put into numbers by hand."""

from __future__ import annotations

import numpy as np
import pytest

from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.described import Coupling, ModelNumbers

NUMBERS = {
    "viscous_friction": ("tilt", (0.4,), ModelNumbers(whole=True, viscous=0.4)),
    "coulomb_friction": ("tilt", (0.4,), ModelNumbers(whole=True, coulomb=0.4)),
    "direction_dependent_friction": (
        "tilt",
        (0.5, 0.25, 0.125, 0.375),
        ModelNumbers(viscous=0.25, coulomb=0.375, offset=-0.125),
    ),
    "stribeck_friction": ("tilt", (0.5, 0.9, 0.1), ModelNumbers(coulomb=0.5)),
    "presliding_friction": ("tilt", (0.5, 0.9), ModelNumbers(coulomb=0.5)),
    "load_dependent_friction": ("tilt", (0.5,), ModelNumbers()),
    "position_dependent_friction": ("tilt", (-0.5, 0.5, 1.5, 0.25, 0.75, 0.5), ModelNumbers(coulomb=0.5)),
    "temperature_dependent_friction": (
        "tilt",
        (0.5, 0.25, -0.02, -0.01, 40.0),
        ModelNumbers(coulomb=0.5, viscous=0.25),
    ),
    "joint_coupling": (
        "turn+slide",
        (0.5, 0.3, 0.2, 0.1),
        ModelNumbers(whole=True, coupling=Coupling("turn", "slide", 0.5, 0.3, 0.2, 0.1)),
    ),
    "cogging": (
        "tilt",
        (6.0, 12.0, 0.3, 0.2, 0.7, -0.7),
        ModelNumbers(whole=True, waves=((6.0, 0.3, 0.7), (12.0, 0.2, -0.7))),
    ),
    "torque_ripple": ("tilt", (6.0, 0.3, 0.7), ModelNumbers()),
    "torque_offset": ("tilt", (-0.4,), ModelNumbers(whole=True, offset=-0.4)),
    "torque_constant": ("tilt", (0.9,), ModelNumbers(whole=True, gain=0.9)),
    "torque_saturation": ("tilt", (3.0,), ModelNumbers(whole=True, limit=3.0)),
    "input_delay": (None, (0.004,), ModelNumbers(whole=True, delay=0.004)),
    "reference_delay": (None, (0.03,), ModelNumbers(whole=True, reference_delay=0.03)),
    "actuator_lag": (None, (0.02,), ModelNumbers(whole=True, lag=0.02)),
    "rotor_inertia": ("tilt", (0.02,), ModelNumbers(whole=True, rotor_inertia=0.02)),
    "parasitic_spring": ("tilt", (4.0, 0.25), ModelNumbers(whole=True, spring=(4.0, 0.25))),
    "backlash": ("tilt", (0.01,), ModelNumbers(whole=True, gap=0.01)),
    "transmission_compliance": ("tilt", (500.0,), ModelNumbers(whole=True, stiffness=500.0)),
    "encoder_offset": ("tilt", (0.05,), ModelNumbers(whole=True, zero=0.05)),
    "encoder_eccentricity": ("tilt", (0.02, 0.7, 1.0), ModelNumbers()),
    "encoder_quantization": ("tilt", (0.01,), ModelNumbers()),
}


@pytest.mark.parametrize("name", NUMBERS)
def test_a_model_holds_the_numbers_of_the_law(arm, name):
    joint, theta, expected = NUMBERS[name]
    assert effect_named(name).model_numbers(arm, joint, np.array(theta)) == expected


def test_a_mass_is_held_whole_by_a_heavier_link(arm):
    found = effect_named("payload").model_numbers(arm, None, np.array([0.5, 0.0, 0.1, 0.2]))
    assert found.whole
    assert found.robot is not None
    assert found.robot(arm).model.inertias[3].mass == pytest.approx(arm.model.inertias[3].mass + 0.5)


def test_a_tilt_is_held_by_the_rotation_that_gravity_takes(arm):
    found = effect_named("base_tilt").model_numbers(arm, None, np.array([0.2, -0.3, 0.0]))
    assert found.robot is not None
    assert found.turned is not None
    gravity = found.robot(arm).model.gravity.linear
    np.testing.assert_allclose(found.turned @ arm.model.gravity.linear, gravity, atol=1e-12)


SIZED = {
    ("coulomb_friction", "tilt", "torque"): (0.3,),
    ("coulomb_friction", "tilt", "mass"): None,
    ("stribeck_friction", "tilt", "static_torque"): None,
    ("torque_constant", "tilt", "ratio"): (1 / 1.3,),
    ("parasitic_spring", "tilt", "stiffness"): (0.3, 0.2),
    ("transmission_compliance", "tilt", "compliance"): (1 / 0.3,),
    ("base_tilt", None, "roll"): (0.3, 0.0, 0.0),
    ("base_tilt", None, "pitch"): (0.0, 0.3, 0.0),
}


@pytest.mark.parametrize(("name", "joint", "parameter"), SIZED)
def test_a_size_makes_the_parameters_of_the_law(arm, name, joint, parameter):
    # Closed forms: an excess e of the logged torque is the ratio 1 / (1 + e), a compliance c the stiffness 1 / c.
    theta = effect_named(name).sized(arm, joint, parameter, 0.3, np.array([0.1, 0.2, 0.3]))
    expected = SIZED[name, joint, parameter]
    assert theta == (None if expected is None else pytest.approx(expected))


@pytest.mark.parametrize(("name", "size"), [("torque_constant", -1.0), ("transmission_compliance", 0.0)])
def test_a_size_at_the_pole_of_its_law_makes_no_parameters(arm, name, size):
    effect = effect_named(name)
    probed = "ratio" if name == "torque_constant" else "compliance"
    assert effect.sized(arm, "tilt", probed, size, np.zeros(3)) is None
