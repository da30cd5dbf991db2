"""Converts the notes of the stages of a diagnosis into sentences."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

from identification.notes import Code, Note, Remark
from identification.words.notes_on_files import FILE_WORDS
from identification.words.notes_on_findings import FINDING_WORDS
from identification.words.notes_on_motion import MOTION_WORDS

WORDS: Mapping[Code, Callable[[Note], str]] = {**MOTION_WORDS, **FINDING_WORDS, **FILE_WORDS}
"""Functions that make the sentence of a note, by its code."""


def sentence(remark: Remark) -> str:
    """The sentence of a note; a plain sentence is returned as it is."""
    return remark if isinstance(remark, str) else WORDS[remark.code](remark)


def sentences(every: Iterable[Remark]) -> tuple[str, ...]:
    """The sentences of several notes."""
    return tuple(sentence(one) for one in every)
