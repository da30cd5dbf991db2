"""Sentences of notes. Oracle: sentences by hand, and the list of codes itself."""

from __future__ import annotations

import pytest

from identification.diagnosis.result import EffectAt
from identification.notes import NOT_HELD, Code, Note
from identification.words.note_words import WORDS, sentence, sentences


def test_every_code_has_a_sentence():
    assert set(WORDS) == set(Code)


def test_a_sentence_stays_as_it_is():
    assert sentences(["log.csv: 3 repeated rows were dropped."]) == ("log.csv: 3 repeated rows were dropped.",)


MOTION = {"file": "a.csv", "has_torque": True}
DRIVE = {"files": ("corrected.xml",), "values": {"delay": 0.01}, "actuators": 0}


@pytest.mark.parametrize(
    ("note", "words"),
    [
        (Note(Code.RUNS_AWAY, None, {"controlled": True, "t": 0.25}), "under the stated controllers: the simulated"),
        (
            Note(Code.NOT_SIMULATED, None, {"controlled": False, "problem": "It is."}),
            "under the recorded torque: it is.",
        ),
        (Note(Code.MOTION_ONLY, None, MOTION), "a.csv: positions and references only: "),
        (Note(Code.MOTION_ONLY, None, MOTION), "The torque of the log is not used."),
        (Note(Code.MOTION_ONLY, None, {**MOTION, "more": 2}), "a.csv and 2 more: positions and references only: "),
        (Note(Code.NO_EXPERIMENT), "the fits of the rivals cannot be compared; take a longer recording."),
        (Note(Code.NOT_WRITTEN, None, {"files": ("a", "b"), "problem": "No."}), "a and b were not written: No."),
        (Note(Code.NOT_WRITTEN, None, {"files": ("a", "b", "c"), "problem": "No."}), "a, b, c were not written: No."),
        (Note(Code.REFUSED, None, {"files": ("a",), "problem": "it is worse"}), "a was not written: it is worse."),
        (Note(Code.NOT_ALONE, None, {"files": ("a",), "other": "b"}), "a was not written: it goes with b."),
        (Note(Code.NO_PLACE, None, {"quantity": "lag", "values": {"j": 0.1}}), "It has no place for lags [s]: j 0.1."),
        (
            Note(Code.NO_PLACE_FOR_DRIVE, "j", DRIVE),
            "corrected.xml: it has no place for what was found",
        ),
    ],
)
def test_the_sentence_of_a_note(note, words):
    assert words in sentence(note)


def test_rivals_that_nothing_separates_are_named_with_what_would():
    pair = (EffectAt("rotor_inertia", "pin"),), (EffectAt("payload", None),)
    told = sentence(Note(Code.NOT_SEPARATED, None, {"pairs": (pair,)}))
    assert told.startswith("No safe motion that was tried separates rotor inertia on joint pin from ")
    assert "take the rotor inertia from the drive's data sheet" in told


def test_what_a_file_does_not_hold_is_a_note_on_files():
    # Oracle: the words of each say that a file is not there or has no place; the list is by code.
    assert Code.NOT_WRITTEN in NOT_HELD
    assert Code.CHECKED not in NOT_HELD
