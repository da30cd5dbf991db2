"""Notes of the stages of a diagnosis: a code, a joint and numbers, which `identification.words` turns into sentences.

Code that sorts, counts, changes or removes notes uses their codes. No stage reads the sentence of another one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum, auto
from typing import Any


class Code(Enum):
    """Topic of a note; `identification.words` has the sentence of each topic."""

    # Recordings without torque, and their controllers.
    TORQUE_ASKED = auto()
    MOTION_ONLY = auto()
    HELD_SEEN = auto()
    REFERENCE_OF_STEP = auto()
    GAINS_ESTIMATED = auto()
    GAIN_BY_FRICTION = auto()
    GAIN_OR_CONSTANT = auto()
    OFFSET_OR_ZERO = auto()
    STRAYS_UNDER_CONTROL = auto()
    # Recordings at rest, events, measured poses, a simulator's own friction, the search, drives, unlike recordings, and
    # bands.
    RESTS_APART = auto()
    CONTROLLER_GIVES_WAY = auto()
    EVENT = auto()
    POSES_LEFT_OUT = auto()
    SOFT_FRICTION = auto()
    BRAKED = auto()
    SEARCH_WITHOUT_END = auto()
    OPEN_ARRIVAL = auto()
    DRIVE_DROPS = auto()
    DRIVE_PROTECTED = auto()
    RECORDINGS_UNLIKE = auto()
    OTHER_BAND = auto()
    # Simulated motion.
    RECORDED_PAST_LIMITS = auto()
    RUNS_PAST_LIMIT = auto()
    RUNS_PAST_LIMITS = auto()
    SHORTER_HORIZON = auto()
    CLOSED_LOOP = auto()
    RUNS_AWAY = auto()
    NOT_SIMULATED = auto()
    # Findings, and the next experiment.
    IMPLAUSIBLE_SIZE = auto()
    FRICTION_DRIVES = auto()
    MISSING_PART = auto()
    POSSIBLE_LOAD = auto()
    DRIVE_SUM = auto()
    PERHAPS_VOLTS = auto()
    HELD_TORQUE = auto()
    CENTER_TO_WRITE = auto()
    ONE_SIDED = auto()
    SUMS = auto()
    MODEL_IN_COMMON = auto()
    ZEROS_COMPARED = auto()
    NO_EXPERIMENT = auto()
    NOT_SEPARATED = auto()
    # Written files: why a file is missing, what it cannot contain, how it was checked.
    NOT_WRITTEN = auto()
    NOT_ALONE = auto()
    WRITTEN_WRONG = auto()
    REFUSED = auto()
    NO_PLACE = auto()
    NO_PLACE_FOR_EFFECT = auto()
    NO_PLACE_FOR_DRIVE = auto()
    NO_PLACE_FOR_LOOPS = auto()
    NO_PLACE_FOR_GRAVITY = auto()
    NO_PLACE_FOR_LINKS = auto()
    NO_PLACE_FOR_POSES = auto()
    PLACES_NOT_IN_IT = auto()
    LOOPS_STAY_OPEN = auto()
    LOOPS_AS_DRAWN = auto()
    AS_IT_WAS_GIVEN = auto()
    GIVEN_FILE_NOT_IN_IT = auto()
    NEAREST_BODY = auto()
    SAME_TORQUES = auto()
    LOCKED_CAN_MOVE = auto()
    NO_SHAPES = auto()
    ONLY_MOTORS = auto()
    REDUCED_LAW = auto()
    ROTOR_UNKNOWN = auto()
    NEEDS_NEWER_MUJOCO = auto()
    DELAYS_CUT = auto()
    FILE_REMARK = auto()
    CHECKED = auto()
    ROLLED_OUT = auto()
    RESIDUAL_HELD = auto()
    WITHIN_TOLERANCE = auto()
    OTHER_NUMBERS = auto()
    ONE_RECORDING_ONLY = auto()


@dataclass(frozen=True)
class Note:
    """Something that a user should know.

    Attributes:
        code: Topic of the note.
        joint: Name of the joint; None if the note does not concern a single joint.
        numbers: Values that the sentence of the note states, by name: numbers, names of files and joints.
    """

    code: Code
    joint: str | None = None
    numbers: Mapping[str, Any] = field(default_factory=dict)

    @property
    def files(self) -> tuple[str, ...]:
        """Names of the written files that the note is about."""
        return self.numbers.get("files", ())

    def with_numbers(self, **numbers: Any) -> Note:
        """The note with these numbers added or replaced."""
        return replace(self, numbers={**self.numbers, **numbers})


Remark = Note | str
"""A note, or a finished sentence from a reader, a check of a file or an effect."""

INCOMPLETE_FILES = frozenset(
    {
        Code.NOT_WRITTEN,
        Code.NOT_ALONE,
        Code.WRITTEN_WRONG,
        Code.REFUSED,
        Code.NO_PLACE,
        Code.NO_PLACE_FOR_EFFECT,
        Code.NO_PLACE_FOR_DRIVE,
        Code.NO_PLACE_FOR_LOOPS,
        Code.NO_PLACE_FOR_GRAVITY,
        Code.NO_PLACE_FOR_LINKS,
        Code.NO_PLACE_FOR_POSES,
        Code.PLACES_NOT_IN_IT,
        Code.LOOPS_STAY_OPEN,
        Code.LOOPS_AS_DRAWN,
        Code.AS_IT_WAS_GIVEN,
        Code.GIVEN_FILE_NOT_IN_IT,
        Code.NEAREST_BODY,
        Code.SAME_TORQUES,
    }
)
"""Codes of notes on files that were not written, and on findings that a file cannot contain."""
