"""Filters references with the first-order lag that a drive applies before its controller, as MJCF files may state."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identification.data.recording import Recording
from phantom_dyn.array_types import read_only
from phantom_dyn.model.robot import Robot
from phantom_dyn.signals.recursive import lagging_linear

# Number of time constants after which the initial state of a filter does not matter.
_FORGOTTEN = 8
# Largest share of a log that may be excluded because the initial state is unknown; otherwise nothing is excluded.
_MOST_LEFT_OUT = 0.1
# Largest number of uniform time steps per row, which limits memory for logs with long gaps.
_STEPS = 10


def with_lagging_references(recording: Recording, robot: Robot) -> Recording:
    """The recording with the references that its controllers get: filtered with the lags that the robot's file states.

    The state of a filter at the start of the log is unknown. The reference before the log is assumed to be the point
    reflection of its beginning. Without a recorded torque, the time in which this assumption matters is excluded.
    """
    rows = [j for j, actuator in enumerate(robot.actuators) if actuator.reference_lag > 0]
    if recording.q_ref is None or not rows or len(recording.t) < 2:
        return recording
    t, q_ref = recording.t, np.array(recording.q_ref)
    count = min(round((t[-1] - t[0]) / float(np.median(np.diff(t)))), _STEPS * len(t)) + 1
    uniform_t = np.linspace(t[0], t[-1], count)
    step = float(uniform_t[1] - uniform_t[0])
    for j in rows:
        lag, x = robot.actuators[j].reference_lag, np.interp(uniform_t, t, q_ref[:, j])
        before = min(int(_FORGOTTEN * lag / step) + 1, count - 1)
        x = np.concatenate([2 * x[0] - x[before:0:-1], x])
        q_ref[:, j] = np.interp(t, uniform_t, lagging_linear(x, step, lag)[before:])
    start_up = (float(t[0]), float(t[0]) + _FORGOTTEN * max(robot.actuators[j].reference_lag for j in rows))
    unknown = (start_up,) if recording.tau is None and start_up[1] - t[0] < _MOST_LEFT_OUT * (t[-1] - t[0]) else ()
    return replace(recording, q_ref=read_only(q_ref), excluded=(*recording.excluded, *unknown))
