"""Counts the equations that samples with feet on the ground would add, without the unknown contact forces.

`phantom-dyn check` reports their number, but no diagnosis uses these equations: they need the inertia of the base and
the place of every contact, and an error of either looks like an error of a joint.
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from identification.data.floating.base_columns import carrying_joints
from identification.data.floating.detected_contacts import slow_motion
from identification.data.recording import Recording
from phantom_dyn.array_types import Array
from phantom_dyn.dynamics.moving_base import contact_null_space, wrench_and_torque
from phantom_dyn.model.robot import Robot

_RATE = 50.0
"""Rate of the samples that are used [Hz]: a little more than twice the edge of the motion's low pass."""
_MARGIN = 0.04
"""Time excluded before and after each change of a contact, as the low pass blurs the change [s]."""


def stance_words(recording: Recording, robot: Robot) -> str:
    """A sentence that says how many equations stance adds, and how well the given model satisfies these equations."""
    base, file = recording.base, recording.file
    if base is None or recording.tau is None or robot.chain is not None:
        return f"{file}: stance adds nothing, as it needs base: floating, torques, and a robot without closed loops."
    motion, tau = slow_motion(recording, robot)
    rate = (len(motion.t) - 1) / (motion.t[-1] - motion.t[0])
    touches = {frame: np.interp(motion.t, recording.t, x) > 0.5 for frame, x in base.contacts.items()}
    steady = np.ones(len(motion.t), dtype=bool)
    for one in touches.values():
        same = np.diff(one, prepend=one[0]) == 0
        steady &= ndimage.minimum_filter1d(same, 2 * round(_MARGIN * rate) + 1)
    rows = np.flatnonzero(steady)[:: max(1, round(rate / _RATE))]
    needed = wrench_and_torque(robot, motion.at(rows))
    given = np.hstack([np.zeros((len(rows), 6)), tau[rows]])
    residuals: list[Array] = []
    modelled: list[Array] = []
    untouched = 0
    for k, row in enumerate(rows):
        frames = [frame for frame, one in touches.items() if one[row]]
        in_contact = (
            np.any([carrying_joints(robot, frame) for frame in frames], axis=0) if frames else np.zeros(robot.nv, bool)
        )
        untouched += int((~in_contact).sum())
        if frames:
            used = np.concatenate([np.ones(6, dtype=bool), in_contact])
            null_space = contact_null_space(robot, motion.q[row], frames, used)
            residuals.append(null_space.T @ (given[k] - needed[k])[used])
            modelled.append(null_space.T @ needed[k][used])
    if not residuals:
        return f"{file}: stance adds nothing, as nothing touches the ground."
    added = sum(map(len, residuals))
    residual_rms, modelled_rms = (np.sqrt(np.mean(np.concatenate(x) ** 2)) for x in (residuals, modelled))
    return (
        f"{file}: stance adds {added / len(rows):.1f} equations per sample that hold for any contact forces, beside "
        f"{untouched / len(rows):.1f} of joints free of contact. In those of stance the given model, its base "
        f"included, leaves {residual_rms:.2g} of {modelled_rms:.2g} (root mean square, N and N m together). No "
        "diagnosis uses them."
    )
