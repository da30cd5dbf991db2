"""Combs of encoder readings. Oracle: known truth, readings rounded to a known step."""

from __future__ import annotations

import numpy as np
import pytest

from phantom_dyn.effects.support.encoder_lattice import _on_lattice, _sharpened, coarse_step

STATED = 1e-4


@pytest.fixture
def swung(rng) -> np.ndarray:
    t = np.linspace(0.0, 8.0, 6000)
    return 0.6 * np.sin(1.7 * t) + 0.3 * np.sin(4.1 * t + rng.uniform(0, 6))


@pytest.mark.parametrize("times", [8, 12.5, 30, 100])
def test_a_coarse_step_is_found_under_noise_of_a_stated_step(swung, rng, times):
    readings = np.round(swung / (times * STATED)) * times * STATED + 0.5 * STATED * rng.normal(size=len(swung))
    assert coarse_step(readings, STATED) == pytest.approx(times * STATED, rel=1e-3)


def test_readings_at_the_stated_step_gather_about_none_that_is_coarser(swung):
    assert coarse_step(np.round(swung / STATED) * STATED, STATED) is None


def test_readings_between_all_levels_gather_about_no_step(swung):
    assert coarse_step(swung, STATED) is None


def test_few_levels_have_no_comb():
    assert coarse_step(np.round(np.linspace(0.0, 1.0, 500) * 9) / 9, STATED) is None


def test_a_step_is_sharpened_to_the_mean_of_the_distances_that_are_multiples_of_it():
    # Least squares by hand: (1.0 x 1 + 2.02 x 2) / (1 + 4); 1.5 is no multiple and is left out.
    assert _sharpened(np.array([1.0, 2.02, 1.5]), 1.0) == pytest.approx(5.04 / 5.0)


def test_a_step_above_all_distances_comes_to_nothing():
    with np.errstate(invalid="ignore"):
        assert np.isnan(_sharpened(np.array([0.3, 0.4]), 10.0))


@pytest.mark.parametrize(("wrong", "believed"), [(2, True), (3, False)])
def test_a_lattice_is_believed_while_no_more_than_two_in_a_hundred_levels_are_off(wrong, believed):
    levels = np.arange(100.0)
    levels[10 : 10 + 10 * wrong : 10] += 0.4
    assert _on_lattice(levels, 1.0) is believed
