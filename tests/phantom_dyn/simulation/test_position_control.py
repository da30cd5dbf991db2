from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from phantom_dyn.errors import ParameterError
from phantom_dyn.simulation.control import Tracking, position_control, torque_over_time

T = np.array([0.0, 1.0, 3.0])


def test_torques_are_linear_between_their_times_and_held_beyond_them():
    law = torque_over_time(T, np.array([[0.0, 5.0], [2.0, 5.0], [6.0, 7.0]]))
    expected = {-1.0: [0, 5], 0.5: [1, 5], 1.0: [2, 5], 2.0: [4, 6], 9.0: [6, 7]}
    for t, torque in expected.items():
        np.testing.assert_allclose(law(t, np.ones(2), np.ones(2)), torque)


def test_position_control_asks_for_gains_times_errors():
    law = position_control(T, np.ones((3, 1)), np.full((3, 1), 2.0), kp=np.array([10.0]), kd=np.array([3.0]))
    np.testing.assert_allclose(law(0.3, np.array([0.6]), np.array([1.0])), 10.0 * 0.4 + 3.0 * 1.0)


def test_the_limit_holds_all_but_what_is_added_behind_it():
    law = torque_over_time(T, np.full((3, 1), 5.0))
    law = replace(law, limits=np.array([2.0]), extra=np.full((3, 1), 0.5))
    np.testing.assert_allclose(law(0.0, np.zeros(1), np.zeros(1)), 2.5)


def test_tables_of_different_length_are_refused():
    with pytest.raises(ParameterError, match=r"q_ref of a tracking law has shape \(2, 1\), wanted \(3, 1\)"):
        Tracking(T, *(np.zeros((n, 1)) for n in (3, 2, 3, 3, 3, 3)), limits=np.ones(1))


@pytest.mark.parametrize("t", [np.zeros(1), np.array([0.0, 0.0, 1.0]), np.array([0.0, np.nan, 1.0])])
def test_times_that_do_not_increase_are_refused(t):
    with pytest.raises(ParameterError, match="The times of a tracking law do not increase"):
        torque_over_time(t, np.zeros((len(t), 1)))


def test_a_torque_that_is_not_finite_is_refused():
    with pytest.raises(ParameterError, match="feedforward of a tracking law is not finite everywhere"):
        torque_over_time(T, np.array([[0.0], [np.nan], [1.0]]))


def test_a_torque_without_a_column_for_each_joint_is_refused():
    with pytest.raises(ParameterError, match=r"The torque has shape \(3,\), wanted a row a time and a column a joint"):
        torque_over_time(T, np.zeros(3))


def test_a_negative_limit_is_refused():
    law = torque_over_time(T, np.zeros((3, 1)))
    with pytest.raises(ParameterError, match="A limit of a tracking law is negative"):
        replace(law, limits=np.array([-1.0]))


def test_gains_may_change_with_time():
    zero = np.zeros((3, 1))
    law = Tracking(T, zero, zero, zero, np.array([[0.0], [4.0], [4.0]]), zero, zero, np.array([np.inf]))
    np.testing.assert_allclose(law(0.5, np.array([-1.0]), np.zeros(1)), 2.0)
