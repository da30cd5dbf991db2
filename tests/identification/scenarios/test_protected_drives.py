"""Protection of servos whose output was not recorded. Oracle: their voltage, in a simulation that shares no code."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.servo_cases import case
from identification.data.drive_loop import DriveLoop
from identification.data.drives.joint_torque import per_speed, per_volt
from identification.data.reading import read_recording
from identification.data.recording import Recording
from identification.diagnosis.columns.session import session_of
from identification.notes import Note
from identification.scenarios.motion_only import motion_robot, with_commanded_torque
from identification.scenarios.protected_drives import protection_notes
from identification.words.note_words import sentence
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Controller, Robot


def servo(kind: str, seed: int, folder: Path) -> tuple[Robot, Recording, DriveLoop]:
    """A servo with its controller, its log without the voltage, and the loop that the voltage shows."""
    urdf, config, log = case(kind, seed).write(folder)
    robot = load_robot(urdf, config=config)
    measured = read_recording(log, robot)
    (loop,) = measured.loops
    assert loop is not None
    drive = robot.actuators[0]
    controller = Controller(kp=loop.gain * per_volt(drive), kd=per_speed(drive))
    stated = motion_robot(replace(robot, actuators=(replace(drive, controller=controller),)))
    return stated, replace(measured, tau=None, voltage=None, loops=(), torque_from={}, slowing=None), loop


def notes_of(robot: Robot, recording: Recording) -> tuple[Note, ...]:
    return protection_notes(session_of(robot, (with_commanded_torque(recording, robot),)))


@pytest.mark.parametrize("seed", [415, 418])
def test_protection_shows_in_the_torque_that_the_model_needs(seed, tmp_path):
    robot, recording, loop = servo("protection", seed, tmp_path)
    (note,) = notes_of(robot, recording)
    assert note.joint == "j0"
    assert note.numbers["beyond"] == pytest.approx(loop.drops_beyond, rel=0.25)
    assert note.numbers["share"] == pytest.approx(loop.dropped, abs=0.06)
    assert "its drive may protect itself" in sentence(note)


@pytest.mark.parametrize("kind", ["null measured", "load measured", "friction measured"])
def test_a_servo_that_does_not_protect_itself_is_not_said_to(kind, tmp_path):
    for seed in (402, 413):
        if case(kind, seed).robot.count("<joint ") == 1:
            robot, recording, _ = servo(kind, seed, tmp_path)
            assert notes_of(robot, recording) == ()


def test_protection_that_is_stated_is_not_said_again(tmp_path):
    robot, recording, loop = servo("protection", 415, tmp_path)
    drive = robot.actuators[0]
    assert drive.controller is not None
    most = loop.drops_to * per_volt(drive)
    stated = replace(drive.controller, drops_beyond=loop.drops_beyond, drops_to=most)
    assert notes_of(replace(robot, actuators=(replace(drive, controller=stated),)), recording) == ()
