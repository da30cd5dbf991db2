"""What a file of the corrected model leaves of the recorded torque, or why it was not written."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class WrittenFile:
    """What a model or a law that was written leaves of the recorded torque, or why it was not written.

    Attributes:
        file: Its name.
        rms_left: Residual by joint [N m or N] with the file, loaded back and run over the recordings; empty where no
            torque was judged.
        rms_given: The same with the given model.
        holds: What was found and the file holds, as ``coulomb_friction j2``.
        lacks: What was found and the file has no place for.
        refused: Why it was not written, a clause; empty if it was.
    """

    file: str
    rms_left: dict[str, float]
    rms_given: dict[str, float]
    holds: tuple[str, ...] = ()
    lacks: tuple[str, ...] = ()
    refused: str = ""
