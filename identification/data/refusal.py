"""Refuses recordings with certain faults, or states the faults as warnings if the user wants a diagnosis anyway."""

from __future__ import annotations

from collections.abc import Iterable

from identification.data.recording import Fault, Recording
from phantom_dyn.errors import LogError


def fault_sentence(file: str, fault: Fault) -> str:
    """A sentence that states a fault, its evidence and what to do."""
    return f"{file}: {fault.what} ({fault.why}): {fault.mend}."


def require_right(recordings: Iterable[Recording]) -> None:
    """Raise an error for the first recording with a certain fault, unless the user wants a diagnosis anyway.

    Args:
        recordings: All recordings of a diagnosis.

    Raises:
        LogError: For a certain fault, in one sentence with evidence and advice.
    """
    for recording in recordings:
        if recording.wrong and not recording.anyway:
            others = len(recording.wrong) - 1
            pronoun = "it" if others == 1 else "them"
            more = f" ({others} more of this kind: phantom-dyn check tells {pronoun})" if others else ""
            first_fault = fault_sentence(recording.file, recording.wrong[0]).removesuffix(".")
            raise LogError(f"{first_fault}; or judge it all the same with --anyway{more}.")


def wrong_with(recordings: Iterable[Recording]) -> tuple[str, ...]:
    """Certain faults of recordings, one clause each, as in ``a.csv: the positions of j1 are in degrees``."""
    return tuple(f"{recording.file}: {fault.what}" for recording in recordings for fault in recording.wrong)


def fault_warnings(recordings: Iterable[Recording]) -> tuple[str, ...]:
    """Certain faults of recordings with evidence and advice, one sentence each."""
    return tuple(fault_sentence(recording.file, fault) for recording in recordings for fault in recording.wrong)
