from __future__ import annotations

import numpy as np
import pytest

from benchmarks.known_changes import gain_case, load_case, told_apart
from identification.pipeline import diagnose

pytestmark = pytest.mark.whole


@pytest.mark.parametrize("make", [gain_case, load_case])
def test_two_recordings_with_a_known_change_tell_causes_apart(make):
    # Known truth: the project's simulator with one cause, a softer controller or a known mass in the second recording.
    case = make(np.random.default_rng(5))
    found = diagnose(case.robot, case.recordings, changes=case.changes)
    assert told_apart(found, case.truth, case.other)


@pytest.mark.parametrize("make", [gain_case, load_case])
def test_a_case_is_drawn_from_its_seed(make):
    first, again = (make(np.random.default_rng(4)).recordings[1].tau for _ in range(2))
    np.testing.assert_array_equal(first, again)
