"""Makes a checked `Recording` of one robot from a file or from a table of columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from identification.data.checks.against_model import check_degrees
from identification.data.checks.check_recording import checked
from identification.data.checks.positions import check_passive
from identification.data.checks.readings.suspects import slow_clock, usual_clock
from identification.data.checks.torques.unknown_torques import without_unknown_torques
from identification.data.drives.compensation import joints_without, put_back_sentences, without_recorder_lag
from identification.data.drives.joint_torque import (
    computed_from_references,
    drive_torque,
    loops_of,
    require_frames,
    torque_sources,
    voltage_slowing,
    with_voltages,
)
from identification.data.drives.lagging_references import with_lagging_references
from identification.data.floating.base_columns import base_readings
from identification.data.floating.detected_contacts import with_detected_contacts
from identification.data.mending import mended
from identification.data.new_runs import with_jumps_excluded
from identification.data.readers.contract_columns import (
    ALONE,
    FEWEST_ROWS,
    FRAME_AXES,
    FRAME_FLAGS,
    MEANT,
    column_of,
)
from identification.data.readers.map_entries import affixed_words, left_out_words
from identification.data.readers.read_table import Files, table_of
from identification.data.recording import Recording, Table, time_text
from identification.data.unknown_drives import unknown_words
from phantom_dyn.array_types import Array, read_only
from phantom_dyn.dynamics.dynamics import gravity_torque
from phantom_dyn.errors import LogError, known_names, listed, shortened
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import side_by_side

# Largest deviation of a quaternion's length from one: it allows for rounding to three decimals.
_UNIT = 2e-3
# Excluded values are interpolated if they are farther from the median than `_WILD` times the farthest included value.
_WILD = 10.0
# Quantity of each optional field of a `Recording`, with which the names of its columns begin, as in ``i.<joint>``.
_OPTIONAL = {"v": "v", "current": "i", "voltage": "u", "q_ref": "q_ref", "v_ref": "v_ref", "x": "x"}


@dataclass(frozen=True)
class ReadOptions:
    """Options of `read_recording` that are the same for several files.

    Attributes:
        columns: Column map (YAML) or the name of a built-in one, if the columns have other names or units.
        topic: Topic of joint states in a bag that has several.
        ref_topic: Topic of the references in a bag, if it differs from that of the joint states.
        excluded: Intervals of time [s] to leave out of every fit.
        anyway: True to use a recording in spite of certain faults.
    """

    columns: str | Path | None = None
    topic: str | None = None
    ref_topic: str | None = None
    excluded: tuple[tuple[float, float], ...] = ()
    anyway: bool = False


def _per_joint(table: Table, quantity: str, joints: Sequence[str]) -> Array | None:
    """Columns of a quantity, ``(N, nv)``, NaN for joints without a column; None if no joint has a column."""
    if not any(f"{quantity}.{joint}" in table.columns for joint in joints):
        return None
    missing = np.full(len(table.columns["t"]), np.nan)
    return side_by_side([table.columns.get(f"{quantity}.{joint}", missing) for joint in joints])


def _complete(table: Table, quantity: str, joints: Sequence[str]) -> tuple[Array | None, tuple[str, ...]]:
    """Columns of an optional quantity, and warnings. If only some joints have one, None is returned with a warning."""
    values = _per_joint(table, quantity, joints)
    lacking = [joint for joint in joints if f"{quantity}.{joint}" not in table.columns]
    if values is None or not lacking:
        return values, ()
    return None, (f"{table.file}: the columns {quantity}. are not used, as {', '.join(lacking)} has none.",)


def _of_frames(table: Table, quantity: str) -> dict[str, Array]:
    """Measured vectors ``(N, 3)`` or quaternions ``(N, 4)`` of one quantity by frame, read-only."""
    axes, start = FRAME_AXES[quantity], f"{quantity}."
    frames = dict.fromkeys(name[len(start) :].rpartition(".")[0] for name in table.columns if name.startswith(start))
    out = {}
    for frame in frames:
        names = [f"{quantity}.{frame}.{axis}" for axis in axes]
        lacking = [name for name in names if name not in table.columns]
        if lacking:
            needs = f"its three axes {axes[0]}, {axes[1]} and {axes[2]}" if len(axes) == 3 else f"all of {listed(axes)}"
            raise LogError(f"{table.file} has no column {lacking[0]}: {MEANT[quantity]} needs {needs}; add it.")
        out[frame] = read_only(np.column_stack([table.columns[name] for name in names]))
    return out


def _poses(table: Table, robot: Robot) -> tuple[dict[str, Array], dict[str, Array]]:
    """Measured positions and orientations by frame; orientations are unit quaternions x, y, z, w.

    Raises:
        LogError: For an unknown frame, a missing axis, an orientation without position, or a quaternion whose length
            is not one.
    """
    positions, turns = _of_frames(table, "p"), _of_frames(table, "o")
    require_frames(robot, positions, "p")
    require_frames(robot, turns, "o")
    for frame, turn in turns.items():
        if frame not in positions:
            raise LogError(
                f"{table.file} has the orientation of {frame} and not its position: add p.{frame}.x, .y and .z, or "
                f"leave the columns o.{frame} out."
            )
        length = np.linalg.norm(turn, axis=1)
        row = int(np.argmax(np.abs(length - 1.0)))
        if abs(length[row] - 1.0) > _UNIT:
            raise LogError(
                f"{table.file}: the orientation of {frame} is a quaternion of length {length[row]:.3g} at "
                f"t = {time_text(table.columns['t'][row])} s, wanted 1: give qx, qy, qz and qw of a "
                "rotation, or delete the row."
            )
        turns[frame] = read_only(turn / length[:, None])
    return positions, turns


def _excluded(table: Table, excluded: Sequence[tuple[float, float]]) -> tuple[tuple[float, float], ...]:
    """The excluded intervals of time [s], after a check that they overlap the log and leave enough rows."""
    t = table.columns["t"]
    for start, stop in excluded:
        if not start < stop:
            raise LogError(f"the excluded stretch {start:g}:{stop:g} ends before it begins: write T0:T1 with T0 < T1.")
        if stop < t[0] or start > t[-1]:
            raise LogError(
                f"the excluded stretch {time_text(start)}:{time_text(stop)} lies outside {table.file}, which "
                f"goes from {time_text(t[0])} s to {time_text(t[-1])} s: give times of the log."
            )
    remaining = (
        int(np.sum(~np.any([(t >= start) & (t <= stop) for start, stop in excluded], axis=0))) if excluded else len(t)
    )
    if remaining < FEWEST_ROWS <= len(t):
        raise LogError(
            f"the excluded stretches leave {remaining} of the {len(t)} rows of {table.file}, too few to tell "
            "anything: leave out less."
        )
    return tuple((float(start), float(stop)) for start, stop in excluded)


def _without_wild_rows(table: Table, excluded: Sequence[tuple[float, float]]) -> Table:
    """The table without excluded rows at its ends, and with very large excluded values in between interpolated.

    Later steps scale signals by their values, and excluded values may be huge, for example in a diverged simulation.
    """
    if not excluded:
        return table
    t = table.columns["t"]
    out = np.any([(t >= start) & (t <= stop) for start, stop in excluded], axis=0)
    inside = np.flatnonzero(~out)
    if not out.any() or not len(inside):
        return table
    ends = slice(int(inside[0]), int(inside[-1]) + 1)
    columns = {name: values[ends] for name, values in table.columns.items()}
    excluded_t, known_t = columns["t"][out[ends]], columns["t"][~out[ends]]
    for name, values in columns.items() if len(excluded_t) else ():
        if name == "t":
            continue
        known = values[~out[ends]]
        far = _WILD * float(np.abs(known - np.median(known)).max())
        if np.abs(values[out[ends]] - np.median(known)).max() > far:
            bridged = np.array(values)
            bridged[out[ends]] = np.interp(excluded_t, known_t, known)
            columns[name] = bridged
    return replace(table, columns=columns)


def _require_joints(table: Table, robot: Robot) -> tuple[str, ...]:
    """Warnings about unused columns, after a check that all columns are of known joints and all joints have positions.

    Raises:
        LogError: For a column of an unknown joint, and for a joint without position.
    """
    locked: dict[str, None] = {}
    unused: list[str] = []
    for name in table.columns:
        column = column_of(name)
        if (
            column is None
            or column.quantity in (*ALONE, *FRAME_AXES, *FRAME_FLAGS)
            or column.of in (*robot.joint_names, *robot.passive_names)
        ):
            continue
        if column.of in robot.locked:
            locked[column.of] = None
            continue
        if column.quantity == "temp":
            unused.append(name)
            continue
        known = known_names(column.of, [*robot.joint_names, *robot.passive_names], "joints")
        # If all joints of the robot have positions, the log may be of a machine with more joints than the robot's file.
        more = all(f"q.{joint}" in table.columns for joint in robot.joint_names)
        raise LogError(
            f"{table.file}: column {shortened(name)} is of the joint {shortened(column.of)}, which {robot.name} does "
            f"not have: {known}{f' {left_out_words(table, robot)}' if more else affixed_words(table, robot)}"
        )
    absent = [joint for joint in robot.joint_names if f"q.{joint}" not in table.columns]
    if len(absent) == 1:
        raise LogError(
            f"{table.file} has no column q.{absent[0]}, but {robot.name} has the joint {absent[0]}: add its position, "
            "map it with --columns, or hold the joint fixed under lock in robot.yaml."
        )
    if absent:
        raise LogError(
            f"{table.file} lacks the positions of {len(absent)} of the {robot.nv} joints of {robot.name}: "
            f"{', '.join(f'q.{joint}' for joint in absent)}: add them, map them with --columns, or hold the joints "
            f"fixed with lock: [{', '.join(absent)}] in robot.yaml."
        )
    out = ()
    if locked:
        out += (f"{table.file}: the columns of {', '.join(locked)} are not used, as the robot holds it fixed.",)
    if unused:
        out += (f"{table.file}: {', '.join(unused)} not used: a temperature of something that is no joint.",)
    return out


def recording(
    table: Table, robot: Robot, *, excluded: Sequence[tuple[float, float]] = (), torque_needed: bool = True
) -> Recording:
    """The recording of one robot from the columns of a table.

    Args:
        table: Columns under their standard names.
        robot: The robot with its joints, their order, and the constants of its drives.
        excluded: Intervals of time [s] to leave out of every fit.
        torque_needed: False if only the motion is used, so that the torque ``tau`` may be None.

    Returns:
        The recording, read-only, with the warnings of the table; its values are not checked yet.

    Raises:
        LogError: For an unknown or missing joint, if there is no quantity to compute a torque from, for a torque that
            is zero on every joint, or for an excluded interval outside the log.
    """
    joints = robot.joint_names
    left_out = _excluded(table, excluded)
    table = with_voltages(_without_wild_rows(table, left_out))
    forces = _of_frames(table, "f")
    require_frames(robot, forces)
    positions, orientations = _poses(table, robot)
    warnings = [*table.warnings, *_require_joints(table, robot), *unknown_words(table.file, robot)]
    sensors = {quantity: _of_frames(table, quantity) for quantity in ("w", "sf")}
    base, base_warnings = base_readings(table, robot, sensors)
    warnings += base_warnings
    optional = {}
    for key, quantity in _OPTIONAL.items():
        optional[key], sentences = _complete(table, quantity, joints)
        # Current and voltage of some joints only are usual: the torque of the others may be measured.
        warnings += sentences if quantity not in ("i", "u") else ()
    warnings += [
        f"{table.file}: the torque of {joint} is not used, as the joint is passive: it has no drive."
        for joint in robot.passive_names
        if np.any(table.columns.get(f"tau.{joint}", 0.0))
    ]
    tau, sentences = drive_torque(table, robot, torque_needed)
    tau, unfiltered = (None, ()) if tau is None else without_recorder_lag(table, robot, tau)
    weightless, torque_from = joints_without(table, robot, "gravity"), torque_sources(table, joints)
    loops = loops_of(table, joints)
    velocity_gain = voltage_slowing(table, robot, torque_from)
    reference_gain, reference_torque_limit = computed_from_references(table, robot, loops, torque_from)
    # The memory of the torques is freed here, before positions are read, unless the caller keeps the table.
    table = replace(table, columns={name: x for name, x in table.columns.items() if not name.startswith("tau.")})
    q = side_by_side([table.columns[f"q.{joint}"] for joint in joints])
    if weightless and robot.floating:
        raise LogError(
            f"{table.file}: compensated: gravity is for robots that are bolted down, and the base of {robot.name} "
            "turns: add the torque that the controller gave against gravity, and leave the entry out."
        )
    if tau is not None and weightless:
        tau = read_only(tau + gravity_torque(robot, q) * np.isin(joints, weightless))
    recording = Recording(
        file=table.file,
        joint_names=tuple(joints),
        t=read_only(table.columns["t"]),
        q=q,
        tau=tau,
        forces=forces,
        positions=positions,
        orientations=orientations,
        excluded=left_out,
        warnings=(*warnings, *sentences, *unfiltered, *(put_back_sentences(table, robot) if tau is not None else ())),
        passive_q={
            name: read_only(table.columns[f"q.{name}"]) for name in robot.passive_names if f"q.{name}" in table.columns
        },
        torque_from=torque_from,
        velocity_gain=velocity_gain,
        loops=loops,
        references_held=table.references_held if robot.reference_hold is None else robot.reference_hold == "zoh",
        reference_gain=reference_gain,
        reference_torque_limit=reference_torque_limit,
        friction_subtracted=joints_without(table, robot, "friction"),
        temperature=_per_joint(table, "temp", joints),
        supply=table.columns.get("supply"),
        named=table.named,
        base=base,
        **optional,
    )
    return with_detected_contacts(with_lagging_references(recording, robot), robot)


def read_recording(
    path: Files,
    robot: Robot,
    *,
    columns: str | Path | None = None,
    topic: str | None = None,
    ref_topic: str | None = None,
    excluded: Sequence[tuple[float, float]] = (),
    torque_needed: bool = True,
    anyway: bool = False,
) -> Recording:
    """A checked recording from a file: ``warnings`` are possible errors, ``wrong`` are certain faults.

    Args:
        path: CSV, NPZ, Parquet, ROS 1 or ROS 2 bag, MCAP, or an episode of a LeRobot dataset; several files hold
            columns of the same rows.
        robot: The robot that was recorded.
        columns: Column map (YAML) or the name of a built-in one, if the columns have other names or units.
        topic: Topic of joint states in a bag that has several.
        ref_topic: Topic of the references in a bag, if it differs from that of the joint states.
        excluded: Intervals of time [s] to leave out of every fit.
        torque_needed: False if only the motion is used.
        anyway: True to use the recording in spite of certain faults.

    Raises:
        LogError: If the file, a column or a value cannot be used; one sentence says which and what to do.
    """
    # An hour of samples is hundreds of megabytes: a table that no variable holds is freed as early as possible.
    found = recording(
        table_of(path, robot, columns, topic, ref_topic), robot, excluded=excluded, torque_needed=torque_needed
    )
    return mended_and_checked(found, robot, anyway=anyway)


def mended_and_checked(found: Recording, robot: Robot, *, anyway: bool = False) -> Recording:
    """A recording with encoder turns and spikes repaired, and with its possible errors and certain faults.

    Args:
        found: The recording as read from the file.
        robot: The robot that was recorded.
        anyway: True to use the recording in spite of certain faults.
    """
    if found.poses_alone:  # poses are measured seconds or minutes apart, so that there is no motion to repair or check
        return replace(found, warnings=(*found.warnings, *check_degrees(found, robot, None, None)), anyway=anyway)
    clock = slow_clock(found)
    if clock is not None and anyway:
        # Read in seconds, the motion would last for days and could not be simulated.
        found = replace(found, t=read_only(found.t * usual_clock(found)))
    found = without_unknown_torques(with_jumps_excluded(mended(found, robot.prismatic), robot.prismatic), robot)
    # Closed chains come first: if they do not close, there is no model to compare with.
    passive, checks = check_passive(found, robot), checked(found, robot)
    wrong = checks.wrong if clock is None or clock in checks.wrong else (clock, *checks.wrong)
    warnings = (*found.warnings, *passive, *checks.warnings)
    return replace(found, warnings=warnings, unread=checks.unread, wrong=wrong, anyway=anyway)


def unassigned_recording(table: Table) -> Recording:
    """A recording of all joints of a table, for checks without a robot.

    A quantity other than the position is used only if all joints have a column of it.
    """
    joints = [name.removeprefix("q.") for name in table.columns if name.startswith("q.")]
    q, tau, v = _per_joint(table, "q", joints), _complete(table, "tau", joints)[0], _complete(table, "v", joints)[0]
    if q is None:
        raise LogError(f"{table.file} has no column q.<joint> (measured position): add it or map it with --columns.")
    found = Recording(
        table.file,
        tuple(joints),
        read_only(table.columns["t"]),
        q,
        tau,
        v,
        q_ref=_complete(table, "q_ref", joints)[0],
        loops=loops_of(table, joints),
        positions=_of_frames(table, "p"),
        orientations=_of_frames(table, "o"),
        warnings=table.warnings,
    )
    if found.poses_alone:
        return found
    prismatic = np.zeros(len(joints), dtype=bool)  # without a robot, all joints count as revolute
    return with_jumps_excluded(mended(found, prismatic), prismatic)
