from __future__ import annotations

import numpy as np
import pytest

from phantom_dyn.errors import ParameterError
from phantom_dyn.walking.footsteps import Command, Joystick


@pytest.fixture
def stick():
    walking = np.array([True, False, True])
    return Joystick(np.array([1.0, 2.0, 4.0]), np.array([0.1, 0.2, 0.3]), np.array([0.0, 0.1, 0.2]), walking)


def test_what_was_set_holds_until_the_next_change(stick):
    assert stick.at(1.0) == Command(0.1, 0.0, True)
    assert stick.at(1.999) == Command(0.1, 0.0, True)
    assert stick.at(3.0) == Command(0.2, 0.1, False)
    assert stick.at(100.0) == Command(0.3, 0.2, True)


def test_before_the_first_change_the_robot_stands(stick):
    assert stick.at(0.999) == Command(0.0, 0.0, False)


def test_the_next_start_is_now_while_walking_and_the_next_press_otherwise(stick):
    assert stick.next_start(1.5) == 1.5
    assert stick.next_start(0.0) == 1.0
    assert stick.next_start(2.5) == 4.0


def test_there_is_no_next_start_after_the_last_stop():
    one = np.array([1.0])
    assert Joystick(one, one, one, np.array([False])).next_start(0.0) is None


def test_times_that_do_not_increase_are_refused():
    two = np.array([1.0, 1.0])
    with pytest.raises(ParameterError, match="times must increase"):
        Joystick(two, two, two, np.array([True, False]))


def test_a_speed_that_is_no_number_is_refused():
    with pytest.raises(ParameterError, match="joystick's speed has a value that is not finite"):
        Joystick(np.array([1.0]), np.array([np.inf]), np.array([0.0]), np.array([True]))
