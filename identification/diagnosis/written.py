"""Residual of a written file of the corrected model on the recordings, or the reason why it was not written."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class WrittenFile:
    """One file of the corrected model: its residual on the recordings, or the reason why it was not written.

    Attributes:
        file: Name of the file.
        rms_left: Residual by joint [N m or N] of the model in the file, loaded again and compared with the recordings;
            empty without torques.
        rms_given: Residual of the given model by joint, on the same recordings.
        holds: Findings that the file contains, such as ``coulomb_friction j2``.
        lacks: Findings that the format of the file cannot express.
        refused: Reason why the file was not written, as a clause; empty if it was.
    """

    file: str
    rms_left: dict[str, float]
    rms_given: dict[str, float]
    holds: tuple[str, ...] = ()
    lacks: tuple[str, ...] = ()
    refused: str = ""
