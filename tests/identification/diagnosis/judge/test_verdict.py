from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identification.diagnosis.judge.verdict import verdict
from identification.diagnosis.result import Unexplained

# Oracle: the contract. A rest is little without structure, or below a tenth of what can be explained; above half of it
# nothing of weight is known, whatever was found.
NO_STRUCTURE, STRUCTURE = False, True


@pytest.mark.parametrize(
    ("found", "structured", "fraction", "expected"),
    [
        (0, NO_STRUCTURE, 0.0, "no_gap"),
        (0, NO_STRUCTURE, 0.9, "no_gap"),
        (0, STRUCTURE, 0.09, "no_gap"),
        (0, STRUCTURE, 0.1, "unknown"),
        (0, STRUCTURE, 0.5, "unknown"),
        (0, STRUCTURE, 1.0, "unknown"),
        (1, NO_STRUCTURE, 0.0, "explained"),
        (1, NO_STRUCTURE, 0.9, "explained"),
        (1, STRUCTURE, 0.09, "explained"),
        (1, STRUCTURE, 0.1, "partly_explained"),
        (1, STRUCTURE, 0.5, "partly_explained"),
        (1, STRUCTURE, 0.51, "unknown"),
        (2, STRUCTURE, 0.3, "partly_explained"),
        (2, STRUCTURE, 1.0, "unknown"),
    ],
)
def test_the_verdict_follows_from_findings_and_what_is_left(quiet, made_up, found, structured, fraction, expected):
    findings = made_up(findings=2).findings[:found]
    assert verdict(findings, Unexplained(fraction, structured, None, None), quiet.columns) == expected


@pytest.mark.parametrize("found", [0, 1])
def test_without_a_usable_sample_nothing_can_be_tested(quiet, made_up, found):
    columns = replace(quiet.columns, usable=tuple(np.zeros_like(use) for use in quiet.columns.usable))
    findings = made_up(findings=1).findings[:found]
    assert verdict(findings, Unexplained(1.0, STRUCTURE, None, None), columns) == "not_testable"
