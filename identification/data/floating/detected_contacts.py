# pyright: reportAttributeAccessIssue=false
"""Detects contacts from torques if no column states them: a leg that carries weight needs more torque than modelled.

A detector knows less than a switch in the foot, as the error of a wrong model looks like a light touch. Contacts are
therefore extended a little beyond what is detected, and a sentence says that they were detected.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import ndimage

from identification.data.floating.base_columns import carrying_joints, filtered_base
from identification.data.recording import Recording
from phantom_dyn.array_types import Array, Bool, Float, read_only
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.errors import LogError
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion
from phantom_dyn.signals.recursive import low_passed
from phantom_dyn.signals.splines import interpolated, quintic_derivatives

_STEPS_HZ = 20.0
"""Edge of a low pass that keeps the difference between swing and stance [Hz]."""
_MARGIN = 0.04
"""Time by which a contact is extended at both ends, as the low pass blurs it [s]."""
_APART = 4.0
"""Least ratio of the high to the low level of a leg's torque at which it is taken to swing and stand in turn."""
_LEVELS = (10.0, 90.0)
"""Percentiles that give the low and the high level."""
_LEANS = 0.05
"""Least torque of a leg that stands, as a share of the torque of the robot's weight on the stretched leg."""


def torque_rest(recording: Recording, robot: Robot) -> tuple[Float[Array, " N"], Float[Array, "N nv"]]:
    """Uniform times [s], and how far torques are from those of the model without contacts [N m or N], not negative.

    Args:
        recording: Recording of a base that is not bolted down, with torques.
        robot: The given model.
    """
    motion, tau = slow_motion(recording, robot)
    return motion.t, np.abs(tau - inverse_dynamics(robot, motion))


def slow_motion(recording: Recording, robot: Robot) -> tuple[Motion, Float[Array, "N nv"]]:
    """Motion and torque [N m or N] at uniform times after a low pass that keeps swings and stances apart.

    Args:
        recording: Recording of a base that is not bolted down, with torques.
        robot: The given model.
    """
    assert recording.tau is not None
    rate = (len(recording.t) - 1) / (recording.t[-1] - recording.t[0])
    t = np.linspace(recording.t[0], recording.t[-1], len(recording.t))
    both = interpolated(t, recording.t, np.hstack([recording.q, recording.tau]))
    edge = min(_STEPS_HZ, 0.2 * rate)
    both = low_passed(both, edge, rate, order=4, padding=min(int(3 * rate / edge), len(t) - 1))
    q, tau = np.hsplit(both, 2)
    there = filtered_base(recording, robot, t, rate, edge)
    return Motion(t, q, *quintic_derivatives(q, rate), base=there), tau


def with_detected_contacts(recording: Recording, robot: Robot) -> Recording:
    """The recording with detected contacts of each leg; unchanged if columns state contacts, or the base is fixed.

    Raises:
        LogError: If there is no torque to detect contacts from.
    """
    base = recording.base
    if base is None or base.contacts:
        return recording
    if recording.tau is None:
        raise LogError(
            f"{recording.file} has neither a column contact.<frame> nor torques to detect contacts from, and "
            f"{robot.name} is not bolted down (base: floating): add one for every foot, 1 while it touches something "
            "and 0 while it does not (0 throughout if the robot hangs)."
        )
    t, rest = torque_rest(recording, robot)
    rate, weight = (len(t) - 1) / (t[-1] - t[0]), _weight(robot)
    contacts = {}
    for frame, length in _legs(robot).items():
        largest = rest[:, carrying_joints(robot, frame)].max(axis=1)
        reach = 2 * max(1, round(_MARGIN * rate)) + 1
        touches = ndimage.maximum_filter1d(_stands(largest, weight * length), reach, axis=0)
        contacts[frame] = read_only(np.interp(recording.t, t, touches) > 0.5, float)
    shares = ", ".join(f"{frame} {100 * x.mean():.0f} %" for frame, x in contacts.items())
    said = (
        f"{recording.file} has no column contact.<frame>: contacts were detected from torques, as shares of the time: "
        f"{shares}. Add what the feet measure if you have it: a light touch looks like a wrong model."
    )
    return replace(recording, base=replace(base, contacts=contacts), warnings=(*recording.warnings, said))


def _stands(largest: Float[Array, " N"], torque: float) -> Bool[Array, " N"]:
    """True while a leg stands.

    Args:
        largest: Largest torque of its joints that the model does not predict [N m or N], shape ``(N,)``.
        torque: Torque of the robot's weight on the stretched leg [N m].
    """
    low, high = np.percentile(largest, _LEVELS)
    if high > _APART * low and high > _LEANS * torque:
        return largest > np.sqrt(max(low, 1e-9) * high)
    return np.full(len(largest), bool(np.median(largest) > _LEANS * torque))


def _weight(robot: Robot) -> float:
    """Weight of all bodies, the base included [N]."""
    mass = sum(float(inertia.mass) for inertia in robot.model.inertias)
    return mass * float(np.linalg.norm(robot.model.gravity.linear))


def _legs(robot: Robot) -> dict[str, float]:
    """A frame at the end of each leg, and the length of the leg [m]."""
    model, out = robot.model, {}
    ends = [joint for joint in range(1, model.njoints) if len(model.children[joint]) == 0]
    for joint in ends:
        frames = [frame for frame in model.frames if frame.parentJoint == joint]
        last = max(frames, key=lambda frame: float(np.linalg.norm(frame.placement.translation)))
        length = float(np.linalg.norm(last.placement.translation))
        while joint > 0:
            length += float(np.linalg.norm(model.jointPlacements[joint].translation)) if model.parents[joint] else 0.0
            joint = model.parents[joint]
        out[last.name] = length
    return out
