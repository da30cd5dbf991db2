"""What a diagnosis works on: recordings that can be used, cut where they are long, and the model with known places."""

from __future__ import annotations

import time
from dataclasses import dataclass

from identification.data.changes import Change
from identification.data.recording import Recording
from identification.data.refusal import require_right
from identification.data.stretches import is_long, note_on_length, stretches
from identification.diagnosis.columns.known_geometry import as_known, of_torques, places_of_loops, with_known_places
from identification.diagnosis.columns.terms import KnownEffect
from identification.geometry.measured import has_poses
from identification.geometry.pins import KnownPlaces
from identification.notes import Said
from identification.regression.triangular import one_blas_thread
from phantom_dyn.errors import LogError
from phantom_dyn.model.robot import Robot


@dataclass(frozen=True)
class Prepared:
    """What a diagnosis works on: of long recordings the stretches that it uses, and nothing of the rest.

    Attributes:
        robot: The model that is judged.
        seen: What fits may see.
        unseen: What no fit sees.
        known: Effects on torques that belong to the given model already.
        changes: What is known to be different between the recordings; empty: nothing.
        tracked: Recordings with measured poses, if there are any.
        places: Places of a closed chain that earlier poses have shown.
        files: Names of all recordings.
        notes: On what is used of long ones.
        started: On the clock that counts the seconds of a diagnosis.
    """

    robot: Robot
    seen: tuple[Recording, ...]
    unseen: tuple[Recording, ...]
    known: tuple[KnownEffect, ...]
    changes: tuple[Change, ...]
    tracked: tuple[Recording, ...]
    places: KnownPlaces | None
    files: tuple[str, ...]
    notes: tuple[Said, ...]
    started: float


# With more threads sums come in another order, and the last digits would depend on the machine.
@one_blas_thread()
def prepared(
    robot: Robot,
    recordings: tuple[Recording, ...],
    *,
    held_out: int = 0,
    known: tuple[KnownEffect, ...] = (),
    changes: tuple[Change, ...] = (),
) -> Prepared:
    """What a diagnosis works on; whoever lets the recordings go then frees the memory of hours.

    Args:
        robot: The model that is judged.
        recordings: With torque, or with measured poses alone.
        held_out: How many of them, from the last, no fit sees.
        known: Effects that belong to the given model already.
        changes: What is known to be different between the recordings; empty: nothing.

    Raises:
        LogError: If a recording cannot be used, or is certainly wrong and not to be judged anyway.
    """
    started = time.perf_counter()
    require_right(recordings)
    robot = with_known_places(robot, known)
    tracked = as_known(robot, recordings, known)
    if changes and any(one.poses_alone for one in recordings):
        raise LogError(
            "A log of poses without torque was given with --recordings, which is about torques: diagnose it by itself."
        )
    count = len(recordings) - held_out
    seen, unseen = (
        tuple(one for one in some if not one.poses_alone) for some in (recordings[:count], recordings[count:])
    )
    notes: tuple[Said, ...] = ()
    if not changes:  # what changed is known of whole recordings
        notes = tuple(note_on_length(one) for one in (*seen, *unseen) if is_long(one))
        seen, unseen = _stretches(seen), _stretches(unseen)
    return Prepared(
        robot,
        seen,
        unseen,
        of_torques(known),
        changes,
        tracked if has_poses(tracked) else (),
        places_of_loops(robot, known),
        files=tuple(recording.file for recording in recordings),
        notes=notes,
        started=started,
    )


def _stretches(recordings: tuple[Recording, ...]) -> tuple[Recording, ...]:
    return tuple(part for recording in recordings for part in stretches(recording))
