"""The report of ``phantom-dyn check`` on one recording: certain faults, corrected values and possible errors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from identification.data.checks.check_recording import Checked, checked
from identification.data.checks.drive_loops import loop_sentences
from identification.data.drives.joint_torque import NoTorqueError
from identification.data.readers.read_table import read_table, table_of
from identification.data.reading import mended_and_checked, recording, unassigned_recording
from identification.data.recording import Fault, Recording
from identification.data.refusal import fault_sentence
from identification.stages import Announcement, Progress, Stage
from phantom_dyn.model.robot import Robot

# Words for measured poses; True if orientations were measured, too.
_MEASURED = {False: "positions", True: "positions and orientations"}


@dataclass(frozen=True, repr=False)
class CheckedRecording:
    """Length, joints and faults of a recording.

    Attributes:
        file: Name of the file.
        joints: Names of the joints.
        samples: Number of samples.
        seconds: Time from the first sample to the last [s].
        wrong: Certain faults; `diagnose` refuses a recording that has one.
        warnings: Sentences on corrected values and possible errors.
        frames: Frames with measured positions; the value is True if the orientation of the frame was measured, too.
        with_robot: True if the recording was checked against a model; without a model, fewer faults are found.
        loops: A sentence on each drive whose control loop could be estimated from the recording.
    """

    file: str
    joints: tuple[str, ...]
    samples: int
    seconds: float
    wrong: tuple[Fault, ...]
    warnings: tuple[str, ...]
    with_robot: bool
    frames: Mapping[str, bool] = field(default_factory=dict)
    loops: tuple[str, ...] = ()

    @property
    def right(self) -> bool:
        """True if the recording has no fault and no warning."""
        return not self.wrong and not self.warnings

    def __repr__(self) -> str:
        rate = (self.samples - 1) / self.seconds
        lines = [
            f"{self.file}: {self.samples} samples, {self.seconds:.6g} s, {rate:.6g} Hz",
            f"joints: {', '.join(self.joints)}",
            *(f"measured {_MEASURED[turned]} of frame {frame}" for frame, turned in self.frames.items()),
            *self.loops,
            *(f"wrong: {fault_sentence(self.file, fault)}" for fault in self.wrong),
            *(f"warning: {warning}" for warning in self.warnings),
        ]
        if self.right:
            limits = "" if self.with_robot else ", as far as can be seen without a robot"
            lines.append(f"nothing is wrong with it{limits}")
        return "\n".join(lines)


def checked_recording(found: Recording, *, with_robot: bool) -> CheckedRecording:
    """Length, joints and faults of a recording that has already been read and checked."""
    return CheckedRecording(
        found.file,
        found.joint_names,
        len(found.t),
        float(found.t[-1] - found.t[0]),
        found.wrong,
        found.warnings,
        with_robot,
        {frame: frame in found.orientations for frame in found.positions},
        loop_sentences(found),
    )


def checked_file(
    path: str | Path,
    robot: Robot | None,
    *,
    columns: str | Path | None = None,
    topic: str | None = None,
    ref_topic: str | None = None,
    progress: Progress = lambda _: None,
) -> CheckedRecording:
    """Length, joints and faults of the recording in a file.

    Args:
        path: A recording in any format that `identification.data.reading.read_recording` reads.
        robot: The robot that was recorded; None for the checks that need no model.
        columns: Column map (YAML) or the name of a built-in one, if the columns have other names or units.
        topic: Topic of joint states in a bag that has several.
        ref_topic: Topic of the references in a bag, if it differs from that of the joint states.
        progress: Called at the start of each stage.

    Raises:
        LogError: If the file cannot be read as a recording.
    """
    if robot is None:
        found = unassigned_recording(read_table(path, columns=columns, topic=topic, ref_topic=ref_topic))
        progress(Announcement(Stage.CHECKING, detail={"file": found.file}))
        result = Checked(()) if found.poses_alone else checked(found, None)
        found, warnings = replace(found, wrong=result.wrong), (*found.warnings, *result.warnings)
    else:
        found = _read(path, robot, columns, topic, ref_topic, progress)
        warnings = (*robot.warnings, *found.warnings)
    return checked_recording(replace(found, warnings=warnings), with_robot=robot is not None)


def _read(
    path: str | Path,
    robot: Robot,
    columns: str | Path | None,
    topic: str | None,
    ref_topic: str | None,
    progress: Progress,
) -> Recording:
    """The checked recording in a file. A file without torques is read if it has only poses, or has references."""

    def read(torque_needed: bool) -> Recording:
        found = recording(table_of(path, robot, columns, topic, ref_topic), robot, torque_needed=torque_needed)
        progress(Announcement(Stage.CHECKING, detail={"file": found.file}))
        return mended_and_checked(found, robot)

    try:
        return read(True)
    except NoTorqueError:
        found = read(False)
        if not found.poses_alone and found.q_ref is None:
            raise
        return found
