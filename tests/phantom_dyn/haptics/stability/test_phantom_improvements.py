"""Published improvements of the PHANToM beside models: figures of Cavusoglu, Feygin and Tendick (2002), section 5."""

from __future__ import annotations

import math

import pytest

from phantom_dyn.haptics.device.published import PHANTOM_1_5_X, PHANTOM_1_5_Y, PHANTOM_1_5_Z, low_frequency_inertia
from phantom_dyn.haptics.stability.phantom_improvements import (
    PUBLISHED_WALL,
    Improvement,
    damping_improvement,
    loop_gain_improvement,
    operational_masses,
    wall_improvement,
)


def test_masses_of_the_dynamic_model_at_the_origin():
    assert operational_masses() == pytest.approx((77.306e-3, 52.491e-3, 32.245e-3), abs=5e-7)


def test_no_one_unit_makes_the_fits_agree_with_the_dynamic_model():
    fits = [low_frequency_inertia(axis) for axis in (PHANTOM_1_5_X, PHANTOM_1_5_Y, PHANTOM_1_5_Z)]
    ratios = [1e-3 * mass / fit for mass, fit in zip(operational_masses(), fits, strict=True)]
    assert ratios == pytest.approx([4.63, 3.29, 3.67], abs=5e-3)


@pytest.fixture(scope="module")
def damping() -> Improvement:
    return damping_improvement()


def test_published_ratio_of_the_damping(damping):
    assert damping.published_ratio == pytest.approx(2.2, rel=1e-12)


@pytest.mark.parametrize(("improvement", "ratio"), [(wall_improvement, 1.35), (loop_gain_improvement, 1.5)])
def test_published_ratios_of_wall_and_loop_gain(improvement, ratio):
    assert improvement().published_ratio == pytest.approx(ratio, rel=1e-12)


@pytest.mark.parametrize("improvement", [wall_improvement, loop_gain_improvement])
def test_no_model_of_the_source_gives_wall_or_loop_gain(improvement):
    assert len(improvement().models) == 4
    for model in improvement().models:
        assert math.isnan(model.ratio)
        assert "cannot give the published figure" in model.says


def test_the_damping_that_the_walls_need_is_half_a_period_times_their_stiffness():
    assert "need a damping of 1 and 1.35 N s/m" in wall_improvement().needs
    assert PUBLISHED_WALL[0] * 0.5e-3 == 1.0


def test_lag_alone_allows_more_than_the_published_120_percent(damping):
    rigid, simulated, *fits = damping.models
    assert rigid.ratio == pytest.approx(5.68, abs=0.01)
    assert 2.2 < simulated.ratio < rigid.ratio
    assert all(fit.ratio > 2.2 for fit in fits)


def test_the_published_dampings_need_two_masses(damping):
    # The limit of a rigid device is proportional to its mass: 52.5 g times 5.0 / 2.54 and 11 / 14.4.
    assert "need 103 g before and 40 g after" in damping.needs
