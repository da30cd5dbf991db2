"""References behind the filter that a drive puts in front of its controller, as an actuator of a MJCF may have one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identification.data.recording import Recording
from phantom_dyn.array_types import read_only
from phantom_dyn.model.robot import Robot
from phantom_dyn.signals.recursive import lagging_linear

# Number of time constants after which a filter has forgotten how it started.
_FORGOTTEN = 8
# Largest share of a log that may be left out for that.
_MOST_LEFT_OUT = 0.1
# Largest number of even steps per row, for logs with long gaps.
_STEPS = 10


def with_lagging_references(recording: Recording, robot: Robot) -> Recording:
    """The recording with the references as its controllers get them: behind the filters that the robot's file states.

    Nobody knows what a filter held at the start of the log. Before it a reference is assumed to be the point reflection
    of its beginning. Without a recorded torque, the time until a wrong assumption is forgotten is left out.
    """
    rows = [j for j, actuator in enumerate(robot.actuators) if actuator.reference_lag > 0]
    if recording.q_ref is None or not rows or len(recording.t) < 2:
        return recording
    t, q_ref = recording.t, np.array(recording.q_ref)
    count = min(round((t[-1] - t[0]) / float(np.median(np.diff(t)))), _STEPS * len(t)) + 1
    even = np.linspace(t[0], t[-1], count)
    step = float(even[1] - even[0])
    for j in rows:
        lag, x = robot.actuators[j].reference_lag, np.interp(even, t, q_ref[:, j])
        before = min(int(_FORGOTTEN * lag / step) + 1, count - 1)
        x = np.concatenate([2 * x[0] - x[before:0:-1], x])
        q_ref[:, j] = np.interp(t, even, lagging_linear(x, step, lag)[before:])
    forgotten = (float(t[0]), float(t[0]) + _FORGOTTEN * max(robot.actuators[j].reference_lag for j in rows))
    unknown = (forgotten,) if recording.tau is None and forgotten[1] - t[0] < _MOST_LEFT_OUT * (t[-1] - t[0]) else ()
    return replace(recording, q_ref=read_only(q_ref), excluded=(*recording.excluded, *unknown))
