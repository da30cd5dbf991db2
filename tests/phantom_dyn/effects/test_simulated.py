from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

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
