from dataclasses import replace

import numpy as np
import pytest

from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.effects.friction.load_dependent_friction import LoadDependentFriction
from phantom_dyn.effects.operation import Operation
from phantom_dyn.motion import Motion

EFFECT = LoadDependentFriction()
THETA = np.array([0.15])


@pytest.fixture(scope="module")
def geared(arm):
    """The arm with rotors, whose torque does not pass the transmission."""
    model = arm.model.copy()
    model.armature = np.array([0.4, 0.5, 0.6])
    return replace(arm, model=model)


def test_the_torque_follows_the_contract(arm, geared, smooth):
    # Contract: -ratio |tl| s. Pinocchio: tl is the torque of the same robot without rotors and friction.
    operation = Operation.of(geared, smooth)
    still = np.zeros(3)
    load = inverse_dynamics(replace(arm, viscous_friction=still, coulomb_friction=still), smooth)[:, 1]
    torque = EFFECT.torque(geared, operation, "tilt", THETA)[:, 1]
    np.testing.assert_allclose(torque, -0.15 * np.abs(load) * np.sign(smooth.v[:, 1]), atol=1e-12)


def test_a_load_that_was_found_is_carried_too(arm, geared, smooth):
    # Closed form: twice the load rubs twice as much.
    operation = Operation.of(geared, smooth)
    found = operation.after_fit(operation.tau, found_load=operation.transmitted)
    one, two = (EFFECT.signature(geared, o, "tilt", ()).columns for o in (operation, found))
    np.testing.assert_allclose(two, 2.0 * one, atol=1e-12)


def test_friction_is_not_negative_and_less_than_the_load(arm):
    # A transmission that loses all that it passes passes nothing.
    assert EFFECT.coefficient_bounds(arm, "tilt", ()) == ((0.0, 1.0),)


def test_a_joint_that_never_reverses_cannot_show_it(arm, smooth):
    forwards = Operation.of(arm, Motion(smooth.t, smooth.q, np.abs(smooth.v) + 0.1, smooth.a))
    assert EFFECT.untestable(arm, forwards, "turn") == "turn never reverses: its friction looks like a constant torque"
    assert EFFECT.untestable(arm, smooth, "turn") is None
