# pyright: reportAttributeAccessIssue=false
"""Detects contacts from torques if no column states them: a leg that carries weight needs more torque than modelled.

Such a detection is less certain than a switch in the foot, because an error of the model looks like a light contact. So
detected contacts are extended a little in time, and a warning says that they were detected.
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

_LOW_PASS_HZ = 20.0
"""Edge of a low pass after which swing and stance can still be distinguished [Hz]."""
_MARGIN = 0.04
"""Time by which a contact is extended at both ends, as the low pass blurs them [s]."""
_LEVEL_RATIO = 4.0
"""A leg both swings and stands in a recording if the high level of its unmodelled torque is this many times the low."""
_LEVELS = (10.0, 90.0)
"""Percentiles that give the low and the high level."""
_STANDING_SHARE = 0.05
"""Smallest unmodelled torque of a standing leg, as a share of the torque of the robot's weight on the stretched leg."""


def unmodelled_torque(recording: Recording, robot: Robot) -> tuple[Float[Array, " N"], Float[Array, "N nv"]]:
    """Uniform times [s], and the magnitude of the difference between torques and the model without contacts [N m or N].

    Args:
        recording: Recording of a floating base, with torques.
        robot: The given model.
    """
    motion, tau = slow_motion(recording, robot)
    return motion.t, np.abs(tau - inverse_dynamics(robot, motion))


def slow_motion(recording: Recording, robot: Robot) -> tuple[Motion, Float[Array, "N nv"]]:
    """Motion and torque [N m or N] at uniform times after a low pass at `_LOW_PASS_HZ`.

    Args:
        recording: Recording of a floating base, with torques.
        robot: The given model.
    """
    assert recording.tau is not None
    rate = (len(recording.t) - 1) / (recording.t[-1] - recording.t[0])
    t = np.linspace(recording.t[0], recording.t[-1], len(recording.t))
    both = interpolated(t, recording.t, np.hstack([recording.q, recording.tau]))
    edge = min(_LOW_PASS_HZ, 0.2 * rate)
    both = low_passed(both, edge, rate, order=4, padding=min(int(3 * rate / edge), len(t) - 1))
    q, tau = np.hsplit(both, 2)
    return Motion(t, q, *quintic_derivatives(q, rate), base=filtered_base(recording, robot, t, rate, edge)), tau


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
    t, unmodelled = unmodelled_torque(recording, robot)
    rate = (len(t) - 1) / (t[-1] - t[0])
    mass = sum(float(inertia.mass) for inertia in robot.model.inertias)  # of all bodies, with the base
    weight = mass * float(np.linalg.norm(robot.model.gravity.linear))
    contacts = {}
    for frame, length in _legs(robot).items():
        largest = unmodelled[:, carrying_joints(robot, frame)].max(axis=1)
        reach = 2 * max(1, round(_MARGIN * rate)) + 1
        touches = ndimage.maximum_filter1d(_standing(largest, weight * length), reach, axis=0)
        contacts[frame] = read_only(np.interp(recording.t, t, touches) > 0.5, float)
    shares = ", ".join(f"{frame} {100 * x.mean():.0f} %" for frame, x in contacts.items())
    warning = (
        f"{recording.file} has no column contact.<frame>: contacts were detected from torques, as shares of the time: "
        f"{shares}. Add what the feet measure if you have it: a light touch looks like a wrong model."
    )
    return replace(recording, base=replace(base, contacts=contacts), warnings=(*recording.warnings, warning))


def _standing(largest: Float[Array, " N"], torque: float) -> Bool[Array, " N"]:
    """True while a leg stands: its unmodelled torque is above the geometric mean of its low and high levels.

    If the levels do not differ enough for the leg to swing and stand in turn, one answer holds for the whole recording.

    Args:
        largest: Largest unmodelled torque of its joints [N m or N], shape ``(N,)``.
        torque: Torque of the robot's weight on the stretched leg [N m].
    """
    low, high = np.percentile(largest, _LEVELS)
    if high > _LEVEL_RATIO * low and high > _STANDING_SHARE * torque:
        return largest > np.sqrt(max(low, 1e-9) * high)
    return np.full(len(largest), bool(np.median(largest) > _STANDING_SHARE * torque))


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
