"""Input of a diagnosis: usable recordings, shortened where they are long, and the model with known corrections."""

from __future__ import annotations

import time
from dataclasses import dataclass

from identification.data.changes import Change
from identification.data.checks.readings.stated_payloads import with_payloads_checked
from identification.data.recording import Recording
from identification.data.refusal import require_right
from identification.data.stretches import is_long, note_on_length, stretches
from identification.data.unknown_drives import without_unread_drives
from identification.diagnosis.columns.known_geometry import (
    corrected_recordings,
    effects_on_torques,
    places_of_loops,
    with_known_places,
)
from identification.diagnosis.columns.terms import KnownEffect
from identification.geometry.measured import has_poses
from identification.geometry.pins import KnownPlaces
from identification.notes import Remark
from identification.regression.triangular import one_blas_thread
from phantom_dyn.errors import LogError
from phantom_dyn.model.robot import Robot


@dataclass(frozen=True)
class Prepared:
    """Input of a diagnosis; of long recordings only the stretches that are used.

    Attributes:
        robot: The given model.
        fitted: Recordings that fits may see.
        held_out: Recordings that no fit sees.
        known: Effects on torques that belong to the given model already.
        changes: Known differences between the recordings; empty if there are none.
        with_poses: Recordings with measured poses, if there are any.
        places: Corrected places of a closed chain, from earlier poses.
        files: Names of all recordings.
        notes: Notes on the stretches of long recordings that are used.
        started: Start of the diagnosis on a monotonic clock [s].
    """

    robot: Robot
    fitted: tuple[Recording, ...]
    held_out: tuple[Recording, ...]
    known: tuple[KnownEffect, ...]
    changes: tuple[Change, ...]
    with_poses: tuple[Recording, ...]
    places: KnownPlaces | None
    files: tuple[str, ...]
    notes: tuple[Remark, ...]
    started: float


# With several threads the order of sums, and so the last digits, would depend on the machine.
@one_blas_thread()
def prepared(
    robot: Robot,
    recordings: tuple[Recording, ...],
    *,
    held_out: int = 0,
    known: tuple[KnownEffect, ...] = (),
    changes: tuple[Change, ...] = (),
) -> Prepared:
    """Prepare the input of a diagnosis; afterwards the caller may release the recordings, which may be hours long.

    Args:
        robot: The given model.
        recordings: With torque, or with measured poses alone.
        held_out: Number of recordings, from the last, that no fit sees.
        known: Effects that belong to the given model already.
        changes: Known differences between the recordings; empty if there are none.

    Raises:
        LogError: If a recording cannot be used, or has a definite fault that the user did not choose to ignore.
    """
    started = time.perf_counter()
    robot = without_unread_drives(with_known_places(robot, known), recordings)
    recordings = with_payloads_checked(robot, recordings, changes)
    require_right(recordings)
    corrected = corrected_recordings(robot, recordings, known)
    if changes and any(one.poses_alone for one in recordings):
        raise LogError(
            "A log of poses without torque was given with --recordings, which is about torques: diagnose it by itself."
        )
    count = len(recordings) - held_out
    fitted, withheld = (
        tuple(one for one in some if not one.poses_alone) for some in (recordings[:count], recordings[count:])
    )
    notes: tuple[Remark, ...] = ()
    if not changes:  # stated differences hold for whole recordings, so these are not shortened
        notes = tuple(note_on_length(one) for one in (*fitted, *withheld) if is_long(one))
        fitted, withheld = (tuple(part for one in some for part in stretches(one)) for some in (fitted, withheld))
    return Prepared(
        robot,
        fitted,
        withheld,
        effects_on_torques(known),
        changes,
        corrected if has_poses(corrected) else (),
        places_of_loops(robot, known),
        files=tuple(recording.file for recording in recordings),
        notes=notes,
        started=started,
    )
