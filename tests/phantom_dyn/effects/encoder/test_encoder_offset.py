from dataclasses import replace

import numpy as np
import pytest

from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.effects.encoder.encoder_offset import EncoderOffset
from phantom_dyn.effects.operation import Operation
from phantom_dyn.motion import Motion
from phantom_dyn.simulation.simulate import Cause, simulate

EFFECT = EncoderOffset()


def test_the_tangent_is_the_finite_difference_of_inverse_dynamics(arm, operation):
    step, here = 1e-6, np.array([0.0, 1.0, 0.0])
    moved = [Motion(operation.t, operation.q + sign * step * here, operation.v, operation.a) for sign in (-1.0, 1.0)]
    slope = (inverse_dynamics(arm, moved[0]) - inverse_dynamics(arm, moved[1])) / (2 * step)
    columns = EFFECT.signature(arm, operation, "tilt", (0.0,)).columns[:, :, 0]
    np.testing.assert_allclose(columns, slope, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("joint", ["tilt", "slide"])
def test_the_law_is_exact_where_coefficient_and_shape_agree(arm, operation, joint):
    columns = EFFECT.signature(arm, operation, joint, (0.3,)).columns[:, :, 0]
    np.testing.assert_allclose(EFFECT.torque(arm, operation, joint, np.array([0.3])), -0.3 * columns, atol=1e-9)


def test_the_recording_shows_the_law_exactly(planar, swinging):
    controller, q0, v0 = swinging
    s = simulate(planar, (Cause(EFFECT, "elbow", np.array([0.03])),), controller, np.linspace(0, 0.3, 61), q0, v0)
    read = Operation.of(planar, Motion(s.t, s.q, s.encoders.v, s.encoders.a))
    law = EFFECT.torque(planar, read, "elbow", np.array([0.03]))
    steady = np.abs(s.links.v).min(axis=1) > 0.3
    assert np.abs(law).max() > 0.1
    np.testing.assert_allclose((s.tau - read.tau + law)[steady][1:-1], 0.0, atol=0.01)


def test_a_first_joint_that_stands_upright_has_no_zero(arm, operation):
    assert EFFECT.untestable(arm, operation, "turn") == (
        "no torque depends on the position of this joint: its zero leaves no trace"
    )


def test_the_side_of_the_encoder_makes_no_difference(arm, operation):
    other = replace(arm, actuators=tuple(replace(one, encoder_side="link") for one in arm.actuators))
    ours, theirs = (EFFECT.torque(robot, operation, "tilt", np.array([0.1])) for robot in (arm, other))
    np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize(("shape", "same"), [(0.9e-4, True), (-0.9e-4, True), (1.1e-4, False), (-1.1e-4, False)])
def test_below_a_tenth_of_a_milliradian_the_column_is_the_tangent(arm, operation, shape, same):
    tangent, columns = (EFFECT.signature(arm, operation, "tilt", (step,)).columns for step in (0.0, shape))
    assert np.array_equal(columns, tangent) is same
    np.testing.assert_allclose(columns, tangent, atol=1e-3 * np.abs(tangent).max())


def test_a_prismatic_joint_may_be_off_by_any_length_and_a_hinge_by_half_a_turn(arm):
    assert EFFECT.coefficient_bounds(arm, "slide", (0.0,)) == ()
    assert EFFECT.coefficient_bounds(arm, "tilt", (0.0,)) == ((-np.pi, np.pi),)


@pytest.mark.parametrize(("share", "hidden"), [(0.9e-6, True), (1.1e-6, False)])
def test_a_zero_that_changes_a_millionth_of_the_torque_leaves_no_trace(arm, operation, share, hidden):
    size = np.abs(operation.partials[0][:, :, 1]).max() / share
    driven = replace(operation, tau=-size * np.eye(40, 3))
    assert (EFFECT.untestable(arm, driven, "tilt") is not None) is hidden
