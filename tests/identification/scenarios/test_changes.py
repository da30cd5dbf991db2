# pyright: reportAttributeAccessIssue=false
from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from identification.data.changes import Change, KnownPayload, robot_in
from identification.diagnosis.columns.own_effects import ALIKE, differences_of
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.operation import Operation
from phantom_dyn.errors import LogError
from phantom_dyn.model.robot import Controller
from phantom_dyn.motion import Motion


def test_a_known_mass_adds_its_torque(pendulum, swing):
    # Closed form: m l^2 a + m g l sin q of a point mass at l below the pin.
    motion = swing(3)
    loaded = robot_in(pendulum, Change("a.csv", KnownPayload(1.5, (0.0, 0.0, -0.9))))
    more = inverse_dynamics(loaded, motion) - inverse_dynamics(pendulum, motion)
    wanted = 1.5 * 0.9**2 * motion.a + 1.5 * 9.81 * 0.9 * np.sin(motion.q)
    np.testing.assert_allclose(more, wanted, atol=1e-9)


def test_the_centre_is_seen_from_the_payload_frame(pendulum):
    model = pendulum.model.copy()
    turned = pin.SE3(pin.rpy.rpyToMatrix(0.0, np.pi / 2, 0.0), np.array([0.0, 0.0, -1.0]))
    model.addFrame(pin.Frame("tool", 1, 0, turned, pin.FrameType.OP_FRAME))
    robot = replace(pendulum, model=model, payload_frame="tool")
    still = Motion(np.zeros(1), np.zeros((1, 1)), np.zeros((1, 1)), np.zeros((1, 1)))
    # 0.2 m along z of the tool is 0.2 m along x of the rod: at rest it pulls by its weight times 0.2 m.
    loaded = robot_in(robot, Change("a.csv", KnownPayload(1.0, (0.0, 0.0, 0.2))))
    torque = inverse_dynamics(loaded, still) - inverse_dynamics(robot, still)
    np.testing.assert_allclose(torque, -9.81 * 0.2)


def test_a_known_mass_is_what_a_payload_of_the_same_numbers_is(pendulum, swing):
    motion = swing(4)
    loaded = robot_in(pendulum, Change("a.csv", KnownPayload(0.4, (0.1, 0.0, -0.3))))
    effect = effect_named("payload").torque(
        pendulum, Operation.of(pendulum, motion), None, np.array([0.4, 0.1, 0, -0.3])
    )
    np.testing.assert_allclose(inverse_dynamics(loaded, motion), inverse_dynamics(pendulum, motion) - effect, atol=1e-9)


def test_known_gains_replace_those_of_the_robot(pendulum):
    gains = Controller("pd", 40.0, 1.0)
    assert robot_in(pendulum, Change("a.csv", controllers={"pin": gains})).actuators[0].controller == gains


def test_nothing_known_is_the_given_robot_itself(pendulum):
    assert robot_in(pendulum, Change("a.csv", KnownPayload(0.0, (0.0, 0.0, 1.0)))) is pendulum


def test_without_changes_recordings_are_alike(pendulum):
    assert differences_of((), pendulum, 2) is ALIKE


def test_where_all_recordings_changed_the_first_is_what_the_others_are_compared_with(pendulum):
    changes = tuple(Change(f"{k}.csv", changed=("controller",)) for k in range(3))
    assert {effect.recording for effect in differences_of(changes, pendulum, 3).own} == {1, 2}


def test_what_changed_in_a_recording_that_is_held_out_is_refused(pendulum):
    changes = (Change("a.csv"), Change("b.csv"), Change("c.csv", changed=("friction",)))
    with pytest.raises(LogError, match=r"c\.csv is held out, so no fit sees what changed in it"):
        differences_of(changes, pendulum, 2)


def test_a_change_in_the_only_recording_is_refused(pendulum):
    with pytest.raises(LogError, match=r"a\.csv is the only recording that fits see, so friction cannot have changed"):
        differences_of((Change("a.csv", changed=("friction",)),), pendulum, 1)
