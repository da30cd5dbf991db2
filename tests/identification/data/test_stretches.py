"""Stretches that stand for a long recording. Oracle: where a made recording moves is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identification.data.recording import Recording
from identification.data.signals import low_pass, shortest_recording
from identification.data.stretches import busiest, note_on_length, stretches

RATE = 20.0


def made(
    seconds: float, moves: tuple[tuple[float, float], ...], gap: tuple[float, float] = (0.0, 0.0), rate: float = RATE
) -> Recording:
    """Two joints: the first swings now and then, the second only in these stretches."""
    t = np.arange(round(seconds * rate)) / rate
    t = t[(t < gap[0]) | (t >= gap[1])]
    swings = np.sin(t) * (t % 300.0 < 150.0)
    seldom = sum((np.sin(2 * t) * ((t >= a) & (t < b)) for a, b in moves), np.zeros(len(t)))
    return Recording("long.csv", ("often", "seldom"), t, np.column_stack([swings, seldom]), None, warnings=("one",))


def test_ten_minutes_are_used_from_end_to_end():
    recording = made(599.0, ())
    assert stretches(recording) == (recording,)
    assert busiest(recording) is recording


def test_two_hours_become_fifteen_stretches_from_beginning_to_end():
    parts = stretches(made(7200.0, ()))
    assert len(parts) == 15
    assert all(part.t[-1] - part.t[0] == pytest.approx(20.0, abs=2 / RATE) for part in parts)
    assert parts[0].t[0] < 480.0
    assert parts[-1].t[0] >= 14 * 480.0 - 20.0


@pytest.mark.parametrize("rate", [0.5, 2.0, 5.0])
def test_a_stretch_of_a_slow_recorder_has_samples_enough_for_a_fit(rate):
    # Oracle: what a recording must last by the band that its rate allows at most.
    parts = stretches(made(20 * 400 / rate, (), rate=rate))
    assert len(parts) == 15
    shortest = shortest_recording(low_pass(0.06 * rate, rate))
    assert all(part.t[-1] - part.t[0] > 1.9 * shortest for part in parts)


def test_a_slow_recording_of_few_samples_is_used_from_end_to_end():
    recording = made(2000.0, (), rate=2.0)
    assert stretches(recording) == (recording,)


def test_a_joint_that_moves_once_in_two_hours_is_in_a_stretch():
    parts = stretches(made(7200.0, ((3000.0, 3020.0),)))
    assert max(float(np.ptp(part.q[:, 1])) for part in parts) > 1.9


def test_a_stretch_has_the_temperatures_of_its_own_rows():
    whole = made(7200.0, ())
    warming = replace(whole, temperature=np.column_stack([whole.t, 2.0 * whole.t]))
    for part in stretches(warming):
        np.testing.assert_array_equal(part.temperature, np.column_stack([part.t, 2.0 * part.t]))


def test_every_stretch_is_one_in_which_a_joint_moves():
    assert all(np.ptp(part.q[:, 0]) > 0.5 for part in stretches(made(7200.0, ())))


def test_what_is_excluded_is_no_movement():
    recording = made(7200.0, ((3000.0, 3020.0),))
    excluded = Recording(
        recording.file, recording.joint_names, recording.t, recording.q, None, excluded=((2990.0, 3030.0),)
    )
    assert max(float(np.ptp(part.q[:, 1])) for part in stretches(excluded)) == 0.0


def test_a_pause_of_an_hour_gives_no_stretch():
    parts = stretches(made(7200.0, (), gap=(1000.0, 4600.0)))
    assert len(parts) == 15
    assert all(np.diff(part.t).max() < 0.1 for part in parts)


def test_warnings_stay_with_the_first_stretch():
    assert [len(part.warnings) for part in stretches(made(7200.0, ()))] == [1] + 14 * [0]


def test_the_busiest_five_minutes_hold_what_moves_once():
    part = busiest(made(7200.0, ((3000.0, 3020.0),)))
    assert part.t[-1] - part.t[0] == pytest.approx(300.0, abs=1.0)
    assert np.ptp(part.q[:, 1]) > 1.9


def test_the_note_says_what_is_used():
    assert note_on_length(made(7200.0, ())) == (
        "long.csv lasts 7200 s: fits and figures are of 15 stretches of 20 s from its beginning to its end, those in "
        "which the joints move most."
    )
