# pyright: reportAttributeAccessIssue=false
"""Findings of measured poses that belong to the given model already: places of joints, zeros and elasticity."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from identification.data.recording import Recording
from identification.diagnosis.model.terms import KnownEffect
from identification.geometry.measured import load_of
from identification.geometry.terms import ELASTIC, LINK, ZERO
from phantom_dyn.model.robot import Robot

Array = np.ndarray

OF_POSES = (LINK, ELASTIC)
"""Effects of poses that no torque law knows; the zero of an encoder is one of both."""


def of_torques(known: tuple[KnownEffect, ...]) -> tuple[KnownEffect, ...]:
    """Those that a model of torques takes: all but places of joints and their elasticity."""
    return tuple(one for one in known if one.effect not in OF_POSES)


def known_twists(known: tuple[KnownEffect, ...]) -> dict[str, Float[Array, " 6"]]:
    """How joints are moved on their parents, by joint, in the joint's axes [m, rad]; several moves in their order."""
    out: dict[str, Array] = {}
    for one in known:
        if one.effect == LINK and one.joint is not None:
            out[one.joint] = moved_on(out.get(one.joint, np.zeros(6)), np.array(one.theta))
    return out


def moved_on(first: Float[Array, " 6"], second: Float[Array, " 6"]) -> Float[Array, " 6"]:
    """One twist for a move and another behind it, in the axes of what was moved."""
    return np.array(pin.log6(pin.exp6(first) * pin.exp6(second)).vector)


def with_known_places(robot: Robot, known: tuple[KnownEffect, ...]) -> Robot:
    """The robot with its joints where earlier poses put them; the same robot without such a finding."""
    twists = known_twists(known)
    if not twists:
        return robot
    model = robot.model.copy()
    for joint, twist in twists.items():
        index = model.getJointId(joint)
        model.jointPlacements[index] = model.jointPlacements[index] * pin.exp6(twist)
    return replace(robot, model=model)


def as_known(robot: Robot, recordings: tuple[Recording, ...], known: tuple[KnownEffect, ...]) -> tuple[Recording, ...]:
    """Recordings of poses with positions as the links have them: less known zeros and deflections under load.

    Args:
        robot: With its joints at their known places; gives the loads.
        recordings: Those without poses stay.
        known: Effects of earlier diagnoses.
    """
    told = [one for one in known if one.effect in (ZERO, ELASTIC) and one.joint in robot.joint_names]
    if not told:
        return recordings
    zeros, compliance = np.zeros(robot.nv), np.zeros(robot.nv)
    for one in told:
        (zeros if one.effect == ZERO else compliance)[robot.joint_names.index(str(one.joint))] += one.theta[0]

    def links(recording: Recording) -> Recording:
        if not recording.positions:
            return recording
        read = replace(recording, q=recording.q - zeros)
        return replace(read, q=read.q - compliance * load_of(robot, read)) if compliance.any() else read

    return tuple(map(links, recordings))
