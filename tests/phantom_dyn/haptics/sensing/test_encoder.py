"""Counts and edges of an encoder: closed forms of simple motions."""

from __future__ import annotations

import numpy as np
import pytest

from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.sensing.encoder import Encoder, record_motion


def test_counts_are_the_rounded_position(rng):
    position = np.cumsum(rng.normal(size=501)) * 0.4
    record = record_motion(Encoder(1.0), position, interval=1e-4, samples_apart=10)
    np.testing.assert_array_equal(record.counts, np.floor(position[::10] + 0.5))


def test_edges_of_a_steady_motion_come_every_step_over_speed():
    position = 0.2 * np.arange(501) * 1e-3  # 0.2 units/s for 0.5 s
    record = record_motion(Encoder(0.01), position, interval=1e-3, samples_apart=1)
    np.testing.assert_allclose(record.edge_time, (np.arange(10) + 0.5) * 0.05, rtol=0, atol=1e-12)


def test_a_motion_there_and_back_passes_every_edge_in_both_directions():
    position = np.concatenate([np.linspace(0, 3, 31), np.linspace(3, 0, 31)[1:]])
    record = record_motion(Encoder(1.0), position, interval=1e-3, samples_apart=1)
    np.testing.assert_array_equal(record.edge_direction, [1, 1, 1, -1, -1, -1])
    assert record.counts[-1] == 0


def test_misplaced_edges_repeat_after_four():
    position = np.arange(2001) * 0.01
    record = record_motion(Encoder(1.0, (0.0, 0.1, 0.0, -0.1)), position, interval=0.01, samples_apart=1)
    spacing = np.diff(record.edge_time)[:16].reshape(4, 4)
    np.testing.assert_allclose(spacing[0], [0.9, 0.9, 1.1, 1.1], rtol=0, atol=1e-9)  # edges 1.1, 2.0, 2.9, 4.0, ...
    np.testing.assert_allclose(spacing, spacing[[0]].repeat(4, axis=0), rtol=0, atol=1e-9)


@pytest.mark.parametrize("step", [0.0, -1e-3, float("nan")])
def test_a_step_that_is_not_positive_is_refused(step):
    with pytest.raises(ParameterError, match="give a motion per count above 0"):
        Encoder(step)


def test_a_misplacement_of_a_quarter_step_is_refused():
    with pytest.raises(ParameterError, match="give four shares of a step"):
        Encoder(1.0, (0.0, 0.25, 0.0, 0.0))


def test_a_motion_shorter_than_two_samples_is_refused():
    with pytest.raises(ParameterError, match="less than two samples: give a longer motion"):
        record_motion(Encoder(), np.zeros(10), interval=1e-3, samples_apart=10)


def test_a_motion_with_a_gap_is_refused():
    with pytest.raises(ParameterError, match="not finite"):
        record_motion(Encoder(), np.array([0.0, np.nan, 0.0]), interval=1e-3, samples_apart=1)
