from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identification.data.changes import Change, robot_in
from identification.data.recording import Recording
from identification.scenarios.motion_only import states_controllers, with_asked_torque
from identification.words.note_words import sentence
from phantom_dyn.errors import LogError
from phantom_dyn.model.robot import Controller


@pytest.fixture
def held(pendulum):
    """The pendulum under known gains."""
    return robot_in(pendulum, Change("a.csv", controllers={"pin": Controller("pd", 40.0, 2.0)}))


@pytest.fixture
def without_torque(pendulum):
    t = np.arange(500) / 100.0
    return Recording("a.csv", pendulum.joint_names, t, np.sin(t)[:, None], None, q_ref=np.sin(t + 0.1)[:, None])


def test_the_torque_is_what_the_controllers_asked_for(held, without_torque):
    # Closed form, but for the ends, where differences are one-sided.
    t = without_torque.t
    found = with_asked_torque(without_torque, held)
    assert found.tau is not None
    wanted = 40.0 * (np.sin(t + 0.1) - np.sin(t)) - 2.0 * np.cos(t)
    np.testing.assert_allclose(found.tau[1:-1, 0], wanted[1:-1], atol=1e-4)
    assert "the torque is what its controllers asked for" in sentence(found.notes[-1])
    assert found.controlled


def test_a_late_controller_asks_later(pendulum, without_torque):
    late = robot_in(pendulum, Change("a.csv", controllers={"pin": Controller("pd", 40.0, 0.0, 0.05)}))
    t = without_torque.t[10:] - 0.05
    found = with_asked_torque(without_torque, late)
    assert found.tau is not None
    np.testing.assert_allclose(found.tau[10:, 0], 40.0 * (np.sin(t + 0.1) - np.sin(t)), atol=1e-9)


def test_a_recorded_torque_stays(held, without_torque):
    measured = replace(without_torque, tau=np.ones((500, 1)))
    assert with_asked_torque(measured, held) is measured


def test_without_references_there_is_no_torque(held, without_torque):
    with pytest.raises(LogError, match=r"a\.csv has neither torque nor references: add tau"):
        with_asked_torque(replace(without_torque, q_ref=None), held)


def test_controllers_that_ask_for_nothing_are_refused(held, without_torque):
    still = replace(without_torque, q=np.zeros((500, 1)), q_ref=np.zeros((500, 1)))
    with pytest.raises(LogError, match="ask for no torque at all"):
        with_asked_torque(still, held)


def test_a_robot_states_controllers_only_if_every_drive_has_one(pendulum, held):
    assert states_controllers(held)
    assert not states_controllers(pendulum)
