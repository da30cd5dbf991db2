from __future__ import annotations

import numpy as np

from phantom_dyn.effects.drive.torque_offset import TorqueOffset


def test_the_torque_is_constant(arm, operation):
    torque = TorqueOffset().torque(arm, operation, "slide", np.array([-1.3]))
    np.testing.assert_array_equal(torque, np.tile([0.0, 0.0, -1.3], (40, 1)))


def test_the_drive_gives_less_by_a_torque_that_pushes_forwards(arm, operation):
    np.testing.assert_array_equal(TorqueOffset().signature(arm, operation, "turn", ()).columns, -1.0)
