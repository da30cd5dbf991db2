"""Assumptions under which the published improvements follow. Oracles: the published figures, and the loops apart."""

from __future__ import annotations

import pytest

from phantom_dyn.errors import EstimationError
from phantom_dyn.haptics.device.axis import RigidAxis
from phantom_dyn.haptics.device.discretisation import discretise
from phantom_dyn.haptics.sensing.loop_simulation import LoopSettings
from phantom_dyn.haptics.sensing.velocity_estimators import IMPROVED, STOCK
from phantom_dyn.haptics.stability.passivity import critical_loop_gain
from phantom_dyn.haptics.stability.phantom_improvements import operational_masses
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
