"""Recordings read with the robot as it was in each of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from identification.known_changes.change import Change
from identification.known_changes.loaded import robot_in
from identification.known_changes.references import states_controllers, with_asked_torque
from identification.recordings import Recording, read_recording
from phantom_dyn.robot import Robot


def read_changed(
    path: str | Path,
    robot: Robot,
    change: Change,
    *,
    columns: str | Path | None = None,
    topic: str | None = None,
    excluded: Sequence[tuple[float, float]] = (),
) -> Recording:
    """A recording, checked against the robot with the load that it carried there.

    Where its controllers are known and it has references, it needs no torque: that is what the controllers asked for.

    Args:
        path: CSV, NPZ, Parquet, ROS 1 or ROS 2 bag, or MCAP.
        robot: The given model.
        change: What is known of this recording.
        columns: Column map (YAML), if the columns have other names or units.
        topic: Topic of sensor_msgs/JointState in a bag that has several.
        excluded: Stretches of time [s] to leave out of every fit, besides those of ``change``.

    Raises:
        LogError: If the file, a column or a value cannot be used; one sentence says which and what to do.
    """
    there = robot_in(robot, change)
    asked = bool(change.controllers) and states_controllers(there)
    left_out = (*excluded, *change.exclude)
    found = read_recording(path, there, columns=columns, topic=topic, excluded=left_out, torque_needed=not asked)
    return with_asked_torque(found, there) if asked else found
