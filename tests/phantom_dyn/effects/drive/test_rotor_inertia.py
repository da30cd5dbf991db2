from __future__ import annotations

import numpy as np
import pinocchio as pin

from phantom_dyn.effects.drive.rotor_inertia import RotorInertia


def test_the_torque_is_minus_i_a(arm, operation):
    # Contract: -I a.
    torque = RotorInertia().torque(arm, operation, "tilt", np.array([0.3]))
    np.testing.assert_array_equal(torque, np.column_stack([0 * operation.t, -0.3 * operation.a[:, 1], 0 * operation.t]))


def test_it_is_the_armature_of_pinocchio(arm, operation):
    # Pinocchio: rnea of the model with that armature asks the drive for more by minus the effect's torque.
    heavier = arm.model.copy()
    heavier.armature = arm.model.armature + np.array([0.0, 0.3, 0.0])

    def needed(model: pin.Model) -> np.ndarray:
        data = model.createData()
        states = zip(operation.q, operation.v, operation.a, strict=True)
        return np.array([pin.rnea(model, data, *state) for state in states])

    torque = RotorInertia().torque(arm, operation, "tilt", np.array([0.3]))
    np.testing.assert_allclose(torque, needed(arm.model) - needed(heavier), atol=1e-12)
