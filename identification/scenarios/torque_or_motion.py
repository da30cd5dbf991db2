"""Chooses what a diagnosis uses: recorded torques, or positions and references of controllers, or measured poses.

Positions and references are used if no torque was recorded, or if the user asks for it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from identification.data.drives.joint_torque import NoTorqueError
from identification.data.recording import Recording
from identification.notes import Code, Note
from identification.scenarios.gains import with_estimated_gains
from identification.scenarios.held_references import with_held_references
from identification.scenarios.motion_only import commanded_robot, with_commanded_torque
from phantom_dyn.errors import LogError
from phantom_dyn.model.robot import Robot

Reader = Callable[[bool], tuple[Recording, ...]]
"""Function that reads the recordings; with the argument True it refuses recordings without torque."""


def torque_or_motion(
    robot: Robot, read: Reader, *, motion_only: bool = False
) -> tuple[Robot, tuple[Recording, ...], bool]:
    """The robot, its recordings, and True if they are diagnosed from positions and references instead of torques.

    The third value is False if only recordings of measured poses lack a torque.

    Args:
        robot: The given model.
        read: Reads the recordings.
        motion_only: True to ignore a recorded torque.

    Raises:
        LogError: If a recording has neither torque nor references, or some have a torque and others none.
    """
    if motion_only:
        return commanded_robot(robot), read(False), True
    try:
        return robot, read(True), False
    except NoTorqueError as refusal:
        recordings = read(False)
        # Recordings that have poses alone need no torque.
        with_motion = [one for one in recordings if not one.poses_alone]
        if len(with_motion) < len(recordings) and all(one.tau is not None for one in with_motion):
            return robot, recordings, False
        if any(one.q_ref is None for one in recordings):
            raise
        measured = [one.file for one in recordings if one.tau is not None]
        if measured:
            raise LogError(f"{refusal} {measured[0]} has one: diagnose them apart.") from refusal
        return commanded_robot(robot), recordings, True


def driven_by_controllers(robot: Robot, recordings: tuple[Recording, ...]) -> tuple[Robot, tuple[Recording, ...]]:
    """The robot with the gains of all its controllers, and recordings with the torque that these controllers command.

    Args:
        robot: The given model; gains that it does not state are estimated.
        recordings: Recordings with references, or with voltages from which a torque can be computed.

    Raises:
        LogError: If references are missing, or a gain cannot be estimated from the motion.
    """
    if all(one.q_ref is not None for one in recordings):
        robot, recordings = with_estimated_gains(robot, recordings)
    driven = tuple(with_held_references(robot, with_commanded_torque(one, robot)) for one in recordings)
    return robot, _with_one_note(driven)


def _with_one_note(recordings: tuple[Recording, ...]) -> tuple[Recording, ...]:
    """The recordings with a single note on their torque, in the first one, instead of one note in each recording.

    The remaining note states how many notes were removed, which differ only in the name of the file.
    """
    first, *others = recordings
    shared = next((note for note in first.notes if note.code is Code.MOTION_ONLY), None)
    if shared is None:
        return recordings
    without_note = tuple(replace(one, notes=tuple(n for n in one.notes if not _same(n, shared))) for one in others)
    removed = sum(len(before.notes) - len(after.notes) for before, after in zip(others, without_note, strict=True))
    notes = tuple(note.with_numbers(more=removed) if note is shared and removed else note for note in first.notes)
    return (replace(first, notes=notes), *without_note)


def _same(one: Note, other: Note) -> bool:
    """True if two notes differ only in the file."""
    return one.code is other.code and one.with_numbers(file="") == other.with_numbers(file="")
