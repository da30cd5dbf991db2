from __future__ import annotations

import numpy as np
import pytest

from phantom_dyn.errors import ParameterError
from phantom_dyn.walking.footsteps import Command, Gait, closed, other, standing, stepped

GAIT = Gait(foot_distance=0.2)


def walked(command, steps):
    stance, swing = standing(GAIT), "right"
    for _ in range(steps):
        stance, swing = stepped(stance, swing, command, GAIT), other(swing)
    return stance, swing


def test_straight_steps_advance_the_body_by_speed_times_step_time():
    stance, _ = walked(Command(0.1, 0.0, True), 4)
    assert (stance.body.x, stance.left.x, stance.right.x) == pytest.approx((0.32, 0.32, 0.24))
    assert (stance.left.y, stance.right.y) == pytest.approx((0.1, -0.1))


def test_steps_with_a_turn_lie_on_a_circle():
    # Closed form: chords of length c that turn by w each lie on a circle of radius c / (2 sin(w / 2)).
    command = Command(0.1, 0.2, True)
    chord, turn = 0.1 * GAIT.step_time, 0.2 * GAIT.step_time
    centre = np.array([0.0, chord / (2 * np.sin(turn / 2))])
    for steps in range(1, 9):
        body = walked(command, steps)[0].body
        assert np.linalg.norm(body.point - centre) == pytest.approx(centre[1])
        assert body.heading == pytest.approx(steps * turn)


def test_the_last_step_puts_the_foot_beside_the_other():
    stance, swing = walked(Command(0.1, 0.2, True), 3)
    last = closed(stance, swing, GAIT)
    assert last.left.heading == last.right.heading
    assert last.foot(other(swing)) == stance.foot(other(swing))
    across = last.left.point - last.right.point
    heading = last.left.heading
    np.testing.assert_allclose(across, 0.2 * np.array([-np.sin(heading), np.cos(heading)]), atol=1e-15)


def test_a_longer_step_than_the_gait_has_is_refused():
    with pytest.raises(ParameterError, match=r"asks for an advance of 0.8 m in a step, more than the gait's 0.15 m"):
        stepped(standing(GAIT), "left", Command(1.0, 0.0, True), GAIT)


def test_a_larger_turn_than_the_gait_has_is_refused():
    with pytest.raises(ParameterError, match=r"asks for a turn of -0.8 rad in a step, more than the gait's 0.2 rad"):
        stepped(standing(GAIT), "left", Command(0.0, -1.0, True), GAIT)


def test_a_gait_with_no_time_on_both_feet_is_refused():
    with pytest.raises(ParameterError, match="gait's double_support is 0: give a positive number"):
        Gait(foot_distance=0.2, double_support=0.0)
