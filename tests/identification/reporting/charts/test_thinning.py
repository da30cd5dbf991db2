from __future__ import annotations

import numpy as np
import pytest

from identification.reporting.charts.thinning import (
    binned_median,
    eventful_stretch,
    gap_starts,
    scatter_choice,
    thinned,
)


def test_a_thinned_curve_keeps_a_spike_of_one_sample():
    y = np.zeros(20000)
    y[7777] = 5.0
    assert len(thinned(y)) <= 1000
    assert 7777 in thinned(y)


def test_a_short_curve_is_kept_whole():
    assert thinned(np.arange(10.0)).tolist() == list(range(10))


def test_a_jump_in_time_starts_a_new_stretch():
    assert gap_starts(np.array([0.0, 0.1, 0.2, 5.0, 5.1])).tolist() == [3]


def test_one_sample_has_no_jump():
    assert gap_starts(np.array([0.0])).tolist() == []


def test_the_eventful_stretch_holds_the_burst_and_stays_in_one_recording():
    t = np.concatenate([np.arange(0, 30, 0.01), np.arange(100, 130, 0.01)])
    residual = np.zeros(len(t))
    residual[np.searchsorted(t, 112.0) : np.searchsorted(t, 115.0)] = 1.0
    shown = t[eventful_stretch(t, residual, 10.0)]
    assert shown[0] <= 112.0
    assert shown[-1] >= 114.98
    assert 9.9 < shown[-1] - shown[0] <= 10.0


def test_a_recording_shorter_than_the_stretch_is_shown_whole():
    t = np.arange(0, 3, 0.01)
    assert eventful_stretch(t, np.ones(300), 10.0) == slice(0, 300)


def test_a_full_stretch_goes_before_a_short_but_violent_recording():
    t = np.concatenate([np.arange(0, 1, 0.01), np.arange(100, 130, 0.01)])
    assert t[eventful_stretch(t, np.where(t < 50, 9.0, 1.0), 10.0)][0] >= 100


def test_the_cloud_has_usable_samples_only_and_not_too_many():
    finite = np.arange(50000) % 2 == 0
    chosen = scatter_choice(finite)
    assert len(chosen) == 3000
    assert finite[chosen].all()


def test_the_median_over_velocity_mixes_no_two_directions():
    v = np.linspace(-1.03, 1.0, 4001)
    _, medians = binned_median(v, np.sign(v))
    assert set(medians) == {-1.0, 1.0}


def test_without_motion_there_is_no_median():
    assert len(binned_median(np.zeros(100), np.ones(100))[0]) == 0


def test_few_samples_get_few_bins_so_that_each_has_a_median():
    x = np.linspace(-1, 1, 150)
    centres, medians = binned_median(x, x)
    assert len(centres) >= 8
    assert medians == pytest.approx(centres, abs=0.1)
