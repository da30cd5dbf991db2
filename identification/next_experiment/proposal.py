"""What the diagnosis proposes to record next."""

from __future__ import annotations

from dataclasses import dataclass

from identification.notes import Note
from phantom_dyn.motion import Motion


@dataclass(frozen=True)
class Proposal:
    """The recording to make next.

    Attributes:
        experiment: As in ``diagnosis.json``; None where nothing is proposed.
        motion: The reference motion.
        notes: On what no recording would separate.
    """

    experiment: dict | None = None
    motion: Motion | None = None
    notes: tuple[Note, ...] = ()
