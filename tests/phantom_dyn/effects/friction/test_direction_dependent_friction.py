from __future__ import annotations

import numpy as np

from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.friction.direction_dependent_friction import DirectionDependentFriction

THETA = np.array([0.5, 0.3, 0.11, 0.23])  # T+, T-, c+, c-


def test_the_torque_follows_the_law_of_its_direction(arm, operation):
    # Contract: -(T+ + c+ v) for v > 0, T- - c- v for v < 0.
    v = operation.v[:, 1]
    torque = DirectionDependentFriction().torque(arm, operation, "tilt", THETA)[:, 1]
    np.testing.assert_allclose(torque[v > 0], -(0.5 + 0.11 * v[v > 0]))
    np.testing.assert_allclose(torque[v < 0], 0.3 - 0.23 * v[v < 0])


def test_there_is_no_torque_at_rest(arm, operation):
    assert DirectionDependentFriction().torque(arm, operation, "turn", THETA)[0, 0] == 0.0


def test_equal_sides_are_coulomb_and_viscous_friction(arm, operation):
    both = DirectionDependentFriction().torque(arm, operation, "tilt", np.array([0.4, 0.4, 0.2, 0.2]))
    coulomb = effect_named("coulomb_friction").torque(arm, operation, "tilt", np.array([0.4]))
    viscous = effect_named("viscous_friction").torque(arm, operation, "tilt", np.array([0.2]))
    np.testing.assert_allclose(both, coulomb + viscous, atol=1e-15)


def test_different_steps_are_coulomb_friction_and_an_offset(arm, operation):
    # T+ = T - o, T- = T + o: the offset o pushes forwards, wherever the joint moves.
    both = DirectionDependentFriction().torque(arm, operation, "tilt", np.array([0.3, 0.5, 0.0, 0.0]))
    coulomb = effect_named("coulomb_friction").torque(arm, operation, "tilt", np.array([0.4]))
    offset = effect_named("torque_offset").torque(arm, operation, "tilt", np.array([0.1]))
    np.testing.assert_allclose(both, coulomb + offset, atol=1e-15)
