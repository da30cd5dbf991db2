"""Recordings that are certainly wrong: refused in a sentence, judged anyway where that is asked for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identification.data.recording import Fault, Recording
from identification.data.refusal import fault_warnings, require_right, wrong_with
from phantom_dyn.errors import LogError

T = np.arange(100) / 100
WRONG = Recording(
    "a.csv", ("j1",), T, T[:, None], T[:, None],
    wrong=(Fault("q of j1 is in degrees", "it reaches 99 rad", "give unit: deg"), Fault("b", "c", "d")),
)  # fmt: skip


def test_a_wrong_recording_is_refused_with_what_to_do():
    told = (
        r"^a\.csv: q of j1 is in degrees \(it reaches 99 rad\): give unit: deg; or judge it all the same with --anyway"
    )
    with pytest.raises(LogError, match=told):
        require_right((WRONG,))


def test_further_faults_are_counted():
    with pytest.raises(LogError, match=r"\(1 more of this kind: phantom-dyn check tells it\)\.$"):
        require_right((WRONG,))


def test_a_wrong_recording_that_is_to_be_judged_anyway_is_not_refused():
    judged = replace(WRONG, anyway=True)
    require_right((judged,))
    assert wrong_with((judged,)) == ("a.csv: q of j1 is in degrees", "a.csv: b")


def test_what_is_wrong_is_said_with_the_file():
    assert wrong_with((WRONG,)) == ("a.csv: q of j1 is in degrees", "a.csv: b")
    assert fault_warnings((WRONG,))[0] == "a.csv: q of j1 is in degrees (it reaches 99 rad): give unit: deg."
