from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.simulated import Simulated


def test_a_drive_without_a_law_for_series_is_stepped_through():
    # Known truth: a drive that gives what was asked of it the sample before.
    late = Simulated(start=np.zeros(2), command=lambda state, dt, tau: (tau, state))
    asked = np.arange(10.0).reshape(5, 2)
    given = late.given(0.01 * np.arange(5), asked)
    np.testing.assert_array_equal(given, np.vstack([np.zeros(2), asked[:-1]]))


def test_what_is_no_drive_leaves_the_torque_alone():
    asked = np.arange(10.0).reshape(5, 2)
    np.testing.assert_array_equal(Simulated().given(0.01 * np.arange(5), asked), asked)


@pytest.mark.parametrize(
    ("name", "theta"),
    [("torque_constant", 0.7), ("torque_saturation", 0.4), ("input_delay", 0.02), ("actuator_lag", 0.03)],
)
def test_a_series_is_what_the_steps_come_to(arm, name, theta):
    # Steps hold each command for a sample of 0.1 ms, a series joins them by straight lines: half a sample apart.
    t = 1e-4 * np.arange(5000)
    asked = np.sin(np.outer(t, [4.0, 7.0, 9.0]))
    drive = effect_named(name).simulated(arm, "tilt", np.array([theta]))
    assert drive.series is not None
    stepped = replace(drive, series=None).given(t, asked)
    np.testing.assert_allclose(drive.given(t, asked), stepped, atol=1e-3)


def test_the_last_step_of_a_drive_is_as_long_as_the_one_before():
    seen = []

    def command(state, dt, tau):
        seen.append(dt)
        return state, tau

    Simulated(command=command).given(np.array([0.0, 0.1, 0.4, 0.45]), np.zeros((4, 1)))
    np.testing.assert_allclose(seen, [0.1, 0.3, 0.05, 0.05])


# Effects that move another robot, add a torque, or both.
MOVED = {
    "viscous_friction": ("tilt", (0.4,)),
    "coulomb_friction": ("slide", (0.4,)),
    "direction_dependent_friction": ("tilt", (0.5, 0.3, 0.11, 0.23)),
    "stribeck_friction": ("tilt", (0.4, 0.9, 0.2)),
    "temperature_dependent_friction": ("tilt", (0.4, 0.2, 0.0, 0.0, 25.0)),
    "load_dependent_friction": ("tilt", (0.15,)),
    "position_dependent_friction": ("tilt", (-0.6, 0.1, 0.5, 0.2, 0.7, 0.3)),
    "torque_offset": ("tilt", (-0.7,)),
    "rotor_inertia": ("slide", (0.3,)),
    "payload": (None, (0.8, 0.1, -0.05, 0.2)),
    "inertial_parameters": ("tilt", (0.1, 0.02, 0.0, -0.03, 0.02, 0.001, 0.02, 0.0, 0.002, 0.02)),
    "base_tilt": (None, (0.2, -0.3, 0.0)),
    "parasitic_spring": ("tilt", (4.0, 0.25)),
    "cogging": ("tilt", (6.0, 0.03, 0.7)),
    "torque_ripple": ("tilt", (6.0, 11.0, 0.03, 0.1, 0.7, -0.3)),
}


@pytest.mark.parametrize("name", MOVED)
def test_what_moves_in_a_simulation_lacks_the_torque_of_the_law(arm, operation, torque_in_steps, name):
    # Inverse dynamics: the drives of the other robot need more by minus the torque of the law, less what is added.
    joint, theta = MOVED[name]
    effect = effect_named(name)
    simulated = effect.simulated(arm, joint, np.array(theta))
    moved = arm if simulated.robot is None else simulated.robot(arm)
    found = inverse_dynamics(arm, operation) - inverse_dynamics(moved, operation)
    if simulated.torque is not None:
        found = found + torque_in_steps(simulated, operation)
    moving = operation.v.all(axis=1)
    expected = effect.torque(arm, operation, joint, np.array(theta))
    np.testing.assert_allclose(found[moving], expected[moving], atol=1e-9)


PROBED = {
    "viscous_friction": "N m s/rad",
    "stribeck_friction": "N m",
    "direction_dependent_friction": "N m s/rad",
    "parasitic_spring": "N m/rad",
    "cogging": "N m",
    "torque_constant": "1",
    "backlash": "rad",
    "presliding_friction": "N m",
}


@pytest.mark.parametrize("name", PROBED)
def test_what_is_probed_has_the_unit_of_its_parameter(arm, operation, name):
    effect = effect_named(name)
    probed = "amplitude" if name == "cogging" else effect.probe(arm, operation, "tilt")[0]
    assert effect.probe_unit(arm, "tilt", probed) == PROBED[name]
