"""Residual of a written file of the corrected model on the recordings, or the reason why it was not written."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class WrittenFile:
    """One file of the corrected model: its residual on the recordings, or the reason why it was not written.

    Attributes:
        file: Its name.
        rms_left: Residual by joint [N m or N] of the file, loaded back and run over the recordings; empty without
            torques.
        rms_given: The same of the given model.
        holds: Findings that the file holds, as ``coulomb_friction j2``.
        lacks: Findings that the file has no place for.
        refused: Why it was not written, a clause; empty if it was.
    """

    file: str
    rms_left: dict[str, float]
    rms_given: dict[str, float]
    holds: tuple[str, ...] = ()
    lacks: tuple[str, ...] = ()
    refused: str = ""
