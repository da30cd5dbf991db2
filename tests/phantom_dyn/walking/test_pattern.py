from __future__ import annotations

import numpy as np
import pytest

from phantom_dyn.walking.footsteps import Gait, Joystick
from phantom_dyn.walking.pattern import pendulum_motion, plan_walk

OMEGA = 3.35
GAIT = Gait(foot_distance=0.17)


def pressed(*changes) -> Joystick:
    t, speed, turn, walking = (np.array(column) for column in zip(*changes, strict=True))
    return Joystick(t.astype(float), speed.astype(float), turn.astype(float), walking.astype(bool))


def landings(phases):
    return [phase.end for phase in phases if phase.swing is not None]


@pytest.mark.parametrize("stop", np.linspace(3.0, 4.6, 9))
def test_a_stop_at_any_time_ends_within_two_steps(stop):
    phases = plan_walk(pressed((0.2, 0.15, 0.1, True), (stop, 0.0, 0.0, False)), GAIT, 10.0, OMEGA)
    after = [time for time in landings(phases) if time > stop]
    assert len(after) <= 2
    assert after[-1] <= stop + 2 * GAIT.step_time + 1e-9


def test_after_a_stop_it_stands_still_between_feet_side_by_side():
    phases = plan_walk(pressed((0.2, 0.15, 0.1, True), (4.0, 0.0, 0.0, False)), GAIT, 12.0, OMEGA)
    last = phases[-1].landing
    assert last.left.heading == last.right.heading
    end = pendulum_motion(phases, np.array([11.99]), OMEGA)
    np.testing.assert_allclose(end.zmp[0], last.middle, atol=1e-12)
    np.testing.assert_allclose(end.com[0], last.middle, atol=1e-5)
    np.testing.assert_allclose(end.velocity[0], 0, atol=1e-5)


def test_the_plan_does_not_know_what_the_joystick_does_later():
    first, later = (0.2, 0.15, 0.0, True), (4.0, 0.05, -0.2, True)
    plain, changed = (plan_walk(pressed(*c), GAIT, 8.0, OMEGA) for c in ((first,), (first, later)))
    for one, two in zip(plain, changed, strict=True):
        if one.start < 4.0:
            np.testing.assert_array_equal(one.points, two.points)
            assert one.landing == two.landing
    assert plain[-1].landing != changed[-1].landing


def test_a_full_reversal_of_the_stick_moves_the_zero_moment_point_by_two_centimetres_for_one_step():
    phases = plan_walk(
        pressed((0.2, 0.15, 0.0, True), (3.0, -0.15, 0.2, True), (5.0, 0.15, -0.2, True)), GAIT, 8.0, OMEGA
    )
    moved = []
    for phase in phases:
        if phase.swing is not None:
            stance = phase.stance.foot("left" if phase.swing == "right" else "right")
            moved.append(np.linalg.norm(phase.points[1] - stance.point))
    largest = sorted(moved)[::-1]
    assert largest[0] < 0.025
    assert largest[2] < 1e-6


def test_motion_is_continuous_over_the_phases():
    phases = plan_walk(pressed((0.2, 0.15, 0.1, True), (4.0, 0.0, 0.0, False)), GAIT, 8.0, OMEGA)
    for phase in phases[1:]:
        around = pendulum_motion(phases, phase.start + np.array([-1e-9, 0.0]), OMEGA)
        for name in ("zmp", "dcm", "com", "velocity", "acceleration"):
            np.testing.assert_allclose(*getattr(around, name), atol=1e-6, err_msg=name)


def test_it_starts_again_after_a_stop():
    phases = plan_walk(pressed((0.2, 0.1, 0.0, True), (2.0, 0.0, 0.0, False), (7.0, 0.1, 0.0, True)), GAIT, 12.0, OMEGA)
    times = landings(phases)
    assert any(time < 5.0 for time in times)
    assert not any(5.0 < time < 7.0 for time in times)
    assert any(time > 8.0 for time in times)


def test_without_a_press_it_stands_over_the_origin():
    phases = plan_walk(pressed((0.0, 0.0, 0.0, False)), GAIT, 30.0, OMEGA)
    states = pendulum_motion(phases, np.linspace(0, 30, 100), OMEGA)
    np.testing.assert_array_equal(states.com, 0.0)
