# pyright: reportAttributeAccessIssue=false
"""Corrections that an earlier diagnosis of measured poses has found, applied to the robot and to new recordings.

They are encoder zeros, joint elasticities, the pose of the base, and placements of joints and of measured targets.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin

from identification.data.recording import Recording
from identification.diagnosis.columns.terms import KnownEffect
from identification.geometry.measured import load_of
from identification.geometry.pins import KnownPlaces
from identification.geometry.terms import BASE_POSE, ELASTIC, LINK, TOOL_POSE, ZERO, pose_of_numbers
from phantom_dyn.array_types import Array, Float
from phantom_dyn.model.robot import Robot

POSE_EFFECTS = (LINK, ELASTIC, BASE_POSE, TOOL_POSE)
"""Effects that only poses show. The zero of an encoder is not one of them: torques show it, too."""


def effects_on_torques(known: tuple[KnownEffect, ...]) -> tuple[KnownEffect, ...]:
    """Known effects that change torques: all but those that only poses show."""
    return tuple(one for one in known if one.effect not in POSE_EFFECTS)


def known_twists(known: tuple[KnownEffect, ...]) -> dict[str, Float[Array, " 6"]]:
    """Correction of each joint's placement on its parent, in the joint's axes [m, rad]; several are multiplied."""
    out: dict[str, Array] = {}
    for one in known:
        if one.effect == LINK and one.joint is not None:
            out[one.joint] = composed_twists(out.get(one.joint, np.zeros(6)), np.array(one.theta))
    return out


def composed_twists(first: Float[Array, " 6"], second: Float[Array, " 6"]) -> Float[Array, " 6"]:
    """Twist of two displacements of a joint in succession, each in the axes of the joint before it is displaced."""
    return np.array(pin.log6(pin.exp6(first) * pin.exp6(second)).vector)


def with_known_places(robot: Robot, known: tuple[KnownEffect, ...]) -> Robot:
    """The robot with placements of joints and targets corrected by earlier poses; the same object without corrections.

    A closed chain is not changed, because with corrected placements its loops would not close as in its files. Its
    corrections are used only in the diagnosis of poses (`places_of_loops`).
    """
    if robot.chain is not None:
        return robot
    twists, targets = known_twists(known), [one for one in known if one.effect == TOOL_POSE]
    if not twists and not targets:
        return robot
    model = robot.model.copy()
    for one in targets:
        frame = model.frames[model.getFrameId(str(one.joint))]
        frame.placement = frame.placement * pose_of_numbers(np.array(one.theta))
    for joint, twist in twists.items():
        index = model.getJointId(joint)
        model.jointPlacements[index] = model.jointPlacements[index] * pin.exp6(twist)
    return replace(robot, model=model)


def places_of_loops(robot: Robot, known: tuple[KnownEffect, ...]) -> KnownPlaces | None:
    """Corrected places of a closed chain; None for an open chain, whose model has them already."""
    if robot.chain is None:
        return None
    targets: dict[str, pin.SE3] = {}
    for one in known:
        if one.effect == TOOL_POSE:
            frame = str(one.joint)
            targets[frame] = targets.get(frame, pin.SE3.Identity()) * pose_of_numbers(np.array(one.theta))
    return KnownPlaces(known_twists(known), targets)


def corrected_recordings(
    robot: Robot, recordings: tuple[Recording, ...], known: tuple[KnownEffect, ...]
) -> tuple[Recording, ...]:
    """Recordings of poses, corrected for a known pose of the base, known encoder zeros, and deflections under load.

    Args:
        robot: The robot with corrected places of its joints, from which the loads are computed.
        recordings: The recordings; those without poses are not changed.
        known: Effects of earlier diagnoses.
    """
    for one in known:
        if one.effect == BASE_POSE:
            recordings = tuple(
                _expressed_in(pose_of_numbers(np.array(one.theta)), recording) for recording in recordings
            )
    in_positions = [one for one in known if one.effect in (ZERO, ELASTIC) and one.joint in robot.joint_names]
    if not in_positions:
        return recordings
    zeros, compliance = np.zeros(robot.nv), np.zeros(robot.nv)
    for one in in_positions:
        (zeros if one.effect == ZERO else compliance)[robot.joint_names.index(str(one.joint))] += one.theta[0]

    def with_link_positions(recording: Recording) -> Recording:
        read = replace(recording, q=recording.q - zeros)
        return replace(read, q=read.q - compliance * load_of(robot, read)) if compliance.any() else read

    return tuple(with_link_positions(one) if one.positions else one for one in recordings)


def _expressed_in(base: pin.SE3, recording: Recording) -> Recording:
    """A recording with its measured poses expressed in the frame of a base."""
    back = base.inverse()
    turn = pin.Quaternion(back.rotation)
    return replace(
        recording,
        positions={frame: p @ back.rotation.T + back.translation for frame, p in recording.positions.items()},
        orientations={
            frame: np.array([(turn * pin.Quaternion(one)).coeffs() for one in turns])
            for frame, turns in recording.orientations.items()
        },
    )
