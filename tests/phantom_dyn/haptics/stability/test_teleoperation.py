"""Teleoperation by position error: closed forms of equal devices, simulated limits against linear ones."""

from __future__ import annotations

import math

import numpy as np
import pytest

from phantom_dyn.haptics.device.axis import Operator, RigidAxis
from phantom_dyn.haptics.device.published import PHANTOM_1_5_X, PHANTOM_1_5_Y, PHANTOM_1_5_Z
from phantom_dyn.haptics.sensing.loop_simulation import LoopSettings
from phantom_dyn.haptics.sensing.velocity_estimators import AveragedDifference, KalmanVelocity
from phantom_dyn.haptics.stability.passivity import critical_loop_gain, simulate_teleoperation, simulated_loop_gain
from phantom_dyn.haptics.stability.virtual_wall import critical_wall

TIP = RigidAxis(0.0525, 1.0)
HELD = TIP.held_by(Operator(0.1, 2.0, 50.0))


def test_equal_devices_bear_half_the_gain_of_one_on_a_wall():
    wall = critical_wall(TIP, LoopSettings()).gain
    assert critical_loop_gain(TIP, TIP, LoopSettings()).gain == pytest.approx(wall / 2, rel=1e-9)


@pytest.mark.parametrize("master", [TIP, HELD], ids=["free", "held"])
def test_simulated_loop_gain_is_the_linear_one(master):
    linear = critical_loop_gain(master, TIP, LoopSettings()).gain
    assert simulated_loop_gain(master, TIP, LoopSettings(), low=10.0, high=1e5) == pytest.approx(linear, rel=0.04)


@pytest.mark.parametrize("estimator", [AveragedDifference(1), KalmanVelocity(10.0)])
def test_simulated_loop_gain_with_damping_is_the_linear_one(estimator):
    settings = LoopSettings(estimator=estimator)
    linear = critical_loop_gain(TIP, TIP, settings, damping=5.0).gain
    found = simulated_loop_gain(TIP, TIP, settings, damping=5.0, low=10.0, high=1e5)
    assert found == pytest.approx(linear, rel=0.04)


def test_too_much_damping_of_a_late_estimate_leaves_no_gain():
    late = LoopSettings(estimator=AveragedDifference(100))
    assert critical_loop_gain(TIP, TIP, late, damping=5.0).gain == 0.0


def test_forces_on_both_devices_are_opposite():
    trace = simulate_teleoperation(TIP, TIP, LoopSettings(), 200.0, damping=1.0)
    np.testing.assert_array_equal(trace.force[:, 0], -trace.force[:, 1])


def test_devices_meet_in_the_middle():
    trace = simulate_teleoperation(TIP, TIP, LoopSettings(), 200.0, damping=1.0, offset=2e-3)
    np.testing.assert_allclose(trace.position[-1], 1e-3, atol=LoopSettings().encoder.step)


@pytest.mark.parametrize(
    ("axis", "gain"), [(PHANTOM_1_5_X, 0.0), (PHANTOM_1_5_Y, 0.0), (PHANTOM_1_5_Z, math.inf)], ids=["x", "y", "z"]
)
def test_the_published_fits_have_no_loop_gain_to_compare(axis, gain):
    assert critical_loop_gain(axis, axis, LoopSettings()).gain == gain
