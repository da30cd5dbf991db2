"""Finds recordings whose torques contradict the payload that the user states for them.

The other recordings show what the robot needs without a payload. If the given model explains those, and a recording
with a stated payload only with another payload, then what is stated is wrong: the mass, the centre, a unit or a frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import permutations

import numpy as np

from identification.data.changes import Change, KnownPayload, robot_in
from identification.data.checks.readings.plausible_fit import AS_MODELLED, ENOUGH, PLAUSIBLE, WITHOUT_LOAD, unexplained
from identification.data.checks.readings.reading import Reading, as_recorded
from identification.data.checks.readings.reading_fits import FAR_BETTER, RIGHT, WORSE, joint_gains_of
from identification.data.checks.smoothed_copy import smoothed
from identification.data.recording import Fault, Recording
from identification.data.stretches import busiest
from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import ChainError
from phantom_dyn.model.robot import Robot

_POUND = 0.45359237  # [kg]
# Robots like the model, without and with a load. Friction and rotors may differ: a slow recording shows no rotors.
_WITHOUT, _WITH = WITHOUT_LOAD._replace(rotor=PLAUSIBLE.rotor), AS_MODELLED._replace(rotor=PLAUSIBLE.rotor)


def with_payloads_checked(
    robot: Robot, recordings: Sequence[Recording], changes: Sequence[Change]
) -> tuple[Recording, ...]:
    """The recordings, with a fault where the torques contradict a stated payload.

    Args:
        robot: The given model, without payloads.
        recordings: All recordings.
        changes: Known changes of each recording; empty if there are none.
    """
    without = [one for one, change in zip(recordings, changes, strict=False) if _is_bare(change)]
    if robot.floating or not without or all(change.payload is None for change in changes):
        return tuple(recordings)
    bare = np.max([_bare_shares(robot, one) for one in without], axis=0)
    return tuple(
        replace(one, wrong=(*one.wrong, *_contradictions(robot, one, change, bare)))
        for one, change in zip(recordings, changes, strict=True)
    )


def _contradictions(robot: Robot, recording: Recording, change: Change, bare: Float[Array, " nv"]) -> tuple[Fault, ...]:
    """The fault of a stated payload, if there is one.

    Args:
        robot: The given model, without payloads.
        recording: The recording.
        change: Its known changes.
        bare: Unexplained share of each joint's torque in recordings without a payload.
    """
    payload, reading = change.payload, _reading(robot, recording)
    if payload is None or payload.mass == 0 or reading is None or recording.wrong:
        return ()
    try:
        stated = unexplained(robot_in(robot, change), reading, _WITHOUT)
        free = unexplained(robot_in(robot, replace(change, payload=None)), reading, _WITH)
    except ChainError:  # with the positions as recorded a closed chain does not close
        return ()
    gains = np.nan_to_num(joint_gains_of(np.log((stated + ENOUGH) / (free + ENOUGH))))
    largest = _worse_half(free)
    as_without = np.log((bare + ENOUGH) / (largest + ENOUGH)) < FAR_BETTER
    joints = (gains >= FAR_BETTER) & (largest <= RIGHT) & as_without
    if not joints.any() or gains.min() < -WORSE:
        return ()

    def worse(corrected: KnownPayload) -> float:
        """Logarithm of the largest ratio of the unexplained share with a payload to that with the best one."""
        shares = unexplained(robot_in(robot, replace(change, payload=corrected)), reading, _WITHOUT)
        return float(_worse_half(np.log((shares + ENOUGH) / (free + ENOUGH))).max())

    excess, mistake = min((worse(corrected), advice) for advice, corrected in _usual_mistakes(payload))
    if excess > WORSE:
        # A free payload can also compensate wrong torque constants that the other recordings hardly show. So the stated
        # payload has to leave a large share unexplained in both halves.
        mistake, joints = "correct its mass [kg] and centre [m]", joints & (np.fmin(*stated) > RIGHT)
    if not joints.any():
        return ()
    j = int(np.argmax(np.where(joints, _worse_half(stated), -np.inf)))
    center = ", ".join(f"{x:.3g}" for x in payload.center)
    frame = robot.payload_frame or "the joint that moves its link"
    return (
        Fault(
            f"its payload is not the stated one of {payload.mass:.3g} kg at ({center}) m",
            f"the model explains the recordings without a payload; with this one {100 * _worse_half(stated)[j]:.0f} % "
            f"of the torque of {robot.joint_names[j]} is left unexplained, with the right one "
            f"{max(100 * largest[j], 0.1):.2g} %",
            f"in recordings.yaml {mistake} (its centre counts from the frame of {frame}); or write changed: [payload] "
            "there in place of payload, and it is estimated",
        ),
    )


def _usual_mistakes(payload: KnownPayload) -> list[tuple[str, KnownPayload]]:
    """Payloads that a user may have meant, with advice: a mass in pounds, another order or sign of axes."""
    out = [(f"write mass: {_POUND * payload.mass:.3g}, if it is in pounds", _POUND * payload.mass, payload.center)]
    centers = [np.array(one) for one in permutations(payload.center)]
    centers += [payload.center * np.array(signs) for signs in ((-1, 1, 1), (1, -1, 1), (1, 1, -1), (-1, -1, 1))]
    for center in centers:
        x, y, z = (float(f"{value:.6g}") for value in center)
        if (x, y, z) != payload.center:
            out.append((f"write center: [{x:g}, {y:g}, {z:g}], if the axes are so", payload.mass, (x, y, z)))
    return [(advice, KnownPayload(mass, center)) for advice, mass, center in out]


def _is_bare(change: Change) -> bool:
    """True if a recording has no payload, and nothing else that differs from the given model."""
    return (change.payload is None or change.payload.mass == 0) and not change.controllers and not change.changed


def _bare_shares(robot: Robot, recording: Recording) -> Float[Array, " nv"]:
    """Unexplained share of each joint's torque without a payload, in the worse half; infinite if it is unknown."""
    unknown, reading = np.full(robot.nv, np.inf), _reading(robot, recording)
    if reading is None:
        return unknown
    try:
        shares = unexplained(robot, reading, _WITHOUT)
    except ChainError:
        return unknown
    return np.where(np.isnan(shares).all(axis=0), np.inf, _worse_half(shares))


def _worse_half(shares: Float[Array, "2 nv"]) -> Float[Array, " nv"]:
    """The larger value of both halves of a recording; zero for a joint whose torque hardly varies in either."""
    return np.nan_to_num(np.fmax(*shares))


def _reading(robot: Robot, recording: Recording) -> Reading | None:
    """Smoothed samples of a recording with torque; None without torque, with measured forces or too little motion."""
    if recording.tau is None or recording.poses_alone or recording.forces:
        return None
    smooth = smoothed(busiest(recording))
    return None if smooth is None else as_recorded(smooth, robot, recording.torque_from)
