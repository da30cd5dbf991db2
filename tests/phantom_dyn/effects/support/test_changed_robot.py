"""Robots that differ from the given one. Oracle: sums by hand, Pinocchio's inertias."""

from __future__ import annotations

import numpy as np
import pytest

from phantom_dyn.effects.support.changed_robot import with_friction, with_gravity, with_parameters, with_rotor_inertia
from phantom_dyn.errors import RobotError


@pytest.mark.parametrize("more", [0.3, -50.0])
def test_friction_adds_to_that_of_the_model_and_is_never_negative(arm, more):
    changed = with_friction(arm, "tilt", viscous=more, coulomb=2.0 * more)
    viscous, coulomb = arm.viscous_friction, arm.coulomb_friction
    np.testing.assert_allclose(changed.viscous_friction, [viscous[0], max(viscous[1] + more, 0.0), viscous[2]])
    np.testing.assert_allclose(changed.coulomb_friction, [coulomb[0], max(coulomb[1] + 2 * more, 0.0), coulomb[2]])


def test_friction_that_is_not_given_stays(planar):
    changed = with_friction(planar, "elbow", viscous=0.25)
    np.testing.assert_array_equal(changed.coulomb_friction, planar.coulomb_friction)
    assert changed.viscous_friction[1] == planar.viscous_friction[1] + 0.25


def test_a_rotor_adds_to_the_armature(planar):
    changed = with_rotor_inertia(planar, "elbow", 0.25)
    np.testing.assert_allclose(changed.rotor_inertia - planar.rotor_inertia, [0.0, 0.25])
    assert with_rotor_inertia(planar, "elbow", -9.0).rotor_inertia[1] == 0.0


def test_parameters_change_body_by_body(arm):
    change = np.zeros(30)
    change[10:20] = [0.5, 0.01, 0.02, 0.03, 0.1, 0.001, 0.1, 0.002, 0.003, 0.1]
    changed = with_parameters(arm, change)
    for body in (1, 2, 3):
        found = changed.model.inertias[body].toDynamicParameters() - arm.model.inertias[body].toDynamicParameters()
        np.testing.assert_allclose(found, change[10 * (body - 1) : 10 * body], atol=1e-12)


@pytest.mark.parametrize(("left", "refused"), [(0.0, True), (-0.1, True), (1e-3, False)])
def test_a_link_that_weighs_nothing_is_refused(arm, left, refused):
    mass = arm.model.inertias[2].mass
    change = np.zeros(30)
    change[10] = left - mass
    if refused:
        with pytest.raises(RobotError, match=r"The link of tilt would weigh .* kg: give more\."):
            with_parameters(arm, change)
    else:
        assert with_parameters(arm, change).model.inertias[2].mass == pytest.approx(left)


def test_gravity_is_the_given_one(arm):
    np.testing.assert_array_equal(with_gravity(arm, np.array([1.0, 2.0, 3.0])).model.gravity.linear, [1.0, 2.0, 3.0])
    assert not with_gravity(arm, np.ones(3)).model.gravity.angular.any()
