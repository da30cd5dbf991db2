"""Published ratios and improvements of the PHANToM."""

import math

import pytest

from phantom_dyn.errors import EstimationError
from phantom_dyn.haptics.device.axis import RigidAxis
from phantom_dyn.haptics.device.discretisation import discretise
from phantom_dyn.haptics.device.published import PHANTOM_1_5_X, PHANTOM_1_5_Y, PHANTOM_1_5_Z, low_frequency_inertia
from phantom_dyn.haptics.sensing.loop_simulation import LoopSettings
from phantom_dyn.haptics.sensing.velocity_estimators import IMPROVED, STOCK
from phantom_dyn.haptics.stability.passivity import critical_loop_gain
from phantom_dyn.haptics.stability.phantom_improvements import (
    PUBLISHED_WALL,
    Improvement,
    damping_improvement,
    loop_gain_improvement,
    operational_masses,
    wall_improvement,
)
from phantom_dyn.haptics.stability.published_ratios import (
    Explained,
    _solved,
    explained_damping,
    explained_loop_gain,
    explained_wall,
)
from phantom_dyn.haptics.stability.virtual_wall import critical_damping_gain


@pytest.fixture(scope="module")
def wall() -> Explained:
    return explained_wall()


@pytest.fixture(scope="module")
def damping() -> Explained:
    return explained_damping()


def test_a_late_amplifier_and_a_damping_give_both_published_walls(wall):
    assert (wall.before, wall.after) == pytest.approx((2000.0, 2700.0), rel=1e-6)


def test_the_lag_of_the_wall_is_that_of_the_linear_condition(wall):
    """Closed form: 0.35 of half a period, and K T/2 of damping; the exact loop differs by its damping over its mass."""
    late, held = wall.assumptions
    assert late.value == pytest.approx(0.35 * 0.5, rel=2e-3)
    assert held.value == pytest.approx(2700 * 0.5e-3, rel=0.01)


def test_the_sampled_loop_is_on_the_edge_at_both_walls(wall):
    """Oracle: eigenvalues of the closed loop."""
    late, held = wall.assumptions
    axis = RigidAxis(operational_masses()[1], held.value)
    for stiffness, lag in ((2000.0, 1e-3 * late.value), (2700.0, 0.0)):
        assert discretise(axis, period=1e-3, delay=lag).spectral_radius(stiffness) == pytest.approx(1.0, abs=1e-6)


def test_one_damping_gives_the_published_ratio_of_the_virtual_dampers(damping):
    assert len(damping.assumptions) == 1
    assert damping.ratio == pytest.approx(11.0 / 5.0, rel=1e-6)


def test_and_with_it_both_published_values_to_which_nothing_was_fitted(damping):
    assert (damping.before, damping.after) == pytest.approx((5.0, 11.0), rel=2.5e-3)


def test_the_mass_of_the_damping_is_that_of_the_dynamic_model(damping):
    """Published inertias give 32.245 g along z at the origin."""
    assert "z, 32.2 g" in damping.assumptions[0].says


def test_without_that_damping_the_ratio_is_far_off():
    axis = RigidAxis(operational_masses()[2], 0.0)
    before, after = (critical_damping_gain(axis, LoopSettings(estimator=one)).gain for one in (STOCK, IMPROVED))
    assert after / before == pytest.approx(5.68, abs=0.01)


def test_a_later_amplifier_gives_the_published_ratio_of_the_loop_gain():
    found = explained_loop_gain()
    assert found.ratio == pytest.approx(1.5, rel=1e-6)
    assert found.assumptions[0].value == pytest.approx(0.25, rel=1e-3)


@pytest.mark.parametrize("damping", [0.5, 2.0])
def test_a_quarter_of_a_millisecond_costs_two_devices_a_third_whatever_their_damping(damping):
    """Oracle: the loop of two devices, with master and slave apart."""
    axis = RigidAxis(operational_masses()[1], damping)
    late, prompt = (critical_loop_gain(axis, axis, LoopSettings(delay=lag)).gain for lag in (0.25e-3, 0.0))
    assert prompt / late == pytest.approx(1.5, rel=1e-3)


def test_an_assumption_that_explains_nothing_is_refused():
    with pytest.raises(EstimationError, match="the assumption does not explain it"):
        _solved(lambda x: x + 1.0, 0.0, 1.0)


def test_masses_of_the_dynamic_model_at_the_origin():
    assert operational_masses() == pytest.approx((77.306e-3, 52.491e-3, 32.245e-3), abs=5e-7)


def test_no_one_unit_makes_the_fits_agree_with_the_dynamic_model():
    fits = [low_frequency_inertia(axis) for axis in (PHANTOM_1_5_X, PHANTOM_1_5_Y, PHANTOM_1_5_Z)]
    ratios = [1e-3 * mass / fit for mass, fit in zip(operational_masses(), fits, strict=True)]
    assert ratios == pytest.approx([4.63, 3.29, 3.67], abs=5e-3)


@pytest.fixture(scope="module")
def improvement() -> Improvement:
    return damping_improvement()


def test_published_ratio_of_the_damping(improvement):
    assert improvement.published_ratio == pytest.approx(2.2, rel=1e-12)


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


def test_lag_alone_allows_more_than_the_published_120_percent(improvement):
    rigid, simulated, *fits = improvement.models
    assert rigid.ratio == pytest.approx(5.68, abs=0.01)
    assert 2.2 < simulated.ratio < rigid.ratio
    assert all(fit.ratio > 2.2 for fit in fits)


def test_the_published_dampings_need_two_masses(improvement):
    # The limit of a rigid device is proportional to its mass: 52.5 g times 5.0 / 2.54 and 11 / 14.4.
    assert "need 103 g before and 40 g after" in improvement.needs
