from __future__ import annotations

import numpy as np
import pytest

from phantom_dyn.errors import ParameterError
from phantom_dyn.walking.footsteps import Gait, Joystick
from phantom_dyn.walking.walker import g1
from phantom_dyn.walking.walking_reference import haptic_signal, walk
from phantom_dyn.walking.zmp import support_polygon, zmp_from_bodies, zmp_from_centroidal_momentum


def going(speed, turn=0.0) -> Joystick:
    return Joystick(np.array([0.2]), np.array([speed]), np.array([turn]), np.array([True]))


def placed(points, foot):
    return foot[:2] + points @ np.array([[np.cos(foot[3]), np.sin(foot[3])], [-np.sin(foot[3]), np.cos(foot[3])]])


def test_ten_seconds_with_a_turn_keep_the_zero_moment_point_of_all_bodies_inside_in_every_sample(reference):
    assert len(reference.t) == 1000
    assert reference.left.position[-1, 3] == pytest.approx(0.48)  # the turn: three steps of 0.2 rad/s * 0.8 s
    assert reference.margin.min() > 0.04


def test_a_robot_with_half_as_wide_soles_walks_the_same_command(joystick):
    assert walk(g1(), joystick, duration=10.0, rate=50.0).margin.min() > 0.005


def test_the_stop_ends_within_two_steps(reference):
    stop = reference.joystick.t[-1]
    assert (reference.landings > stop).sum() <= 2
    assert reference.landings[-1] <= stop + 2 * reference.gait.step_time
    after = reference.t > reference.landings[-1]
    assert (reference.left.contact & reference.right.contact)[after].all()


def test_the_soles_never_overlap_at_the_largest_turn_of_the_standard_gait(biped):
    turning = walk(biped, going(0.15, 0.24), duration=5.0, rate=25.0)
    sides = zip(biped.corners, np.roll(biped.corners, 1, axis=0), strict=True)
    outline = np.concatenate([np.linspace(start, end, 20) for start, end in sides])
    for left, right in zip(turning.left.position, turning.right.position, strict=True):
        assert support_polygon(placed(biped.corners, left)).margin(placed(outline, right)).max() < -0.01


def test_joints_stay_within_their_speed_limits(biped, reference):
    speed = np.abs(reference.motion.v[:, 6:]).max(axis=0)
    assert (speed < biped.model.velocityLimit[6:]).all()


def test_the_zero_moment_point_of_the_walk_is_the_same_three_ways(biped, reference):
    motion = reference.motion
    some = slice(0, None, 25)
    arguments = biped.model, motion.q[some], motion.v[some], motion.a[some]
    for way in (zmp_from_bodies, zmp_from_centroidal_momentum):
        np.testing.assert_allclose(way(*arguments), reference.zmp[some], rtol=0, atol=1e-12)


def test_the_planned_zero_moment_point_misses_the_swing_of_the_leg_by_centimetres(reference):
    # The pendulum has no angular momentum: this is why the margin is taken of all bodies.
    miss = np.linalg.norm(reference.zmp - reference.pendulum.zmp, axis=1)
    assert 0.02 < miss.max() < 0.06


def test_standing_has_the_margin_of_a_point_between_the_soles(biped):
    # Closed form: the middle of the hull of both soles is as far from its front edge as half a sole is long.
    still = walk(biped, Joystick(*np.zeros((3, 1)), np.array([False])), duration=0.1)
    np.testing.assert_allclose(still.margin, 0.10, atol=1e-9)
    assert len(still.polygons) == 1


def test_polygons_change_at_each_lift_and_each_landing(reference):
    assert len(reference.polygons) == 1 + 2 * len(reference.landings)
    assert reference.polygon_index[-1] == len(reference.polygons) - 1


def test_faster_steps_leave_less_margin_and_the_hand_feels_it(biped):
    quick = Gait(foot_distance=biped.foot_distance, single_support=0.3, double_support=0.1, longest_step=0.4)
    slow, fast = (walk(biped, going(v, 0.2), duration=3.0, rate=50.0, gait=quick) for v in (0.1, 0.3))
    assert fast.margin.min() < 0 < slow.margin.min()
    assert fast.haptic_signal(silent_above=0.04).max() == 1.0
    assert slow.haptic_signal(silent_above=0.04).max() < 0.5


def test_the_haptic_signal_rises_in_a_line_as_the_margin_goes():
    margin = np.array([0.08, 0.04, 0.03, 0.01, 0.0, -0.1])
    np.testing.assert_allclose(haptic_signal(margin, silent_above=0.04), [0, 0, 0.25, 0.75, 1, 1], atol=1e-15)


def test_a_haptic_signal_that_is_never_silent_is_refused():
    with pytest.raises(ParameterError, match="silent above a margin of 0 m: give more than 0"):
        haptic_signal(np.zeros(1), silent_above=0.0)


def test_a_walk_without_a_sample_is_refused(biped):
    with pytest.raises(ParameterError, match="A walk of 0 s at 100 Hz has no sample"):
        walk(biped, going(0.1), duration=0.0)
