"""Walls and teleoperation: passive and critical gains, linear and simulated.

Published ratios and improvements of the PHANToM.
"""

import math
from functools import partial

import numpy as np
import pytest

from phantom_dyn.errors import EstimationError, ParameterError
from phantom_dyn.haptics.device.axis import Operator, RigidAxis
from phantom_dyn.haptics.device.discretisation import discretise
from phantom_dyn.haptics.device.published import (
    LHIFAM,
    PHANTOM_1_5_X,
    PHANTOM_1_5_Y,
    PHANTOM_1_5_Z,
)
from phantom_dyn.haptics.device.transfer_function import TransferFunction
from phantom_dyn.haptics.sensing.encoder import Encoder, record_motion
from phantom_dyn.haptics.sensing.loop_simulation import LoopSettings, gain_until_swinging
from phantom_dyn.haptics.sensing.velocity_estimators import (
    IMPROVED,
    STOCK,
    AdaptiveWindow,
    AveragedDifference,
    KalmanVelocity,
    estimate_velocity,
)
from phantom_dyn.haptics.stability.critical_stiffness import critical_stiffness
from phantom_dyn.haptics.stability.phantom_improvements import (
    PUBLISHED_WALL,
    Explained,
    Improvement,
    _solved,
    damping_improvement,
    explained_damping,
    explained_loop_gain,
    explained_wall,
    loop_gain_improvement,
    operational_masses,
    wall_improvement,
)
from phantom_dyn.haptics.stability.virtual_wall import (
    critical_damping_gain,
    critical_loop_gain,
    critical_wall,
    simulate_teleoperation,
    simulate_wall,
    simulated_damping_gain,
    velocity_filter,
)

TIP = RigidAxis(0.0525, 0.0)

DAMPED = RigidAxis(0.0525, 1.0)


def swinging_from(run, *, low, high):
    """Gain at which a simulated loop with the usual encoder begins to swing on."""
    return gain_until_swinging(run, LoopSettings().encoder.step, low=low, high=high)


def net_lead(axis: TransferFunction) -> float:
    """Time by which the fit turns the phase forward at low frequency [s]."""
    top, bottom = axis.numerator, axis.denominator[:3]
    return top[-2] / top[-1] - bottom[-2] / bottom[-1]


@pytest.mark.parametrize(
    ("axis", "lead"), [(PHANTOM_1_5_X, -7.36e-4), (PHANTOM_1_5_Y, -4.96e-4), (PHANTOM_1_5_Z, 2.05e-3)]
)
def test_net_lead_of_the_published_fits(axis, lead):
    assert net_lead(axis) == pytest.approx(lead, rel=3e-3)


@pytest.mark.parametrize("damping", [0.0, 5.0])
def test_critical_wall_is_the_critical_stiffness_of_the_two_coefficient_loop(damping):
    settings = LoopSettings(delay=0.4e-3)
    other = critical_stiffness(LHIFAM, period=1e-3, delay=0.4e-3, virtual_damping=damping)
    assert critical_wall(LHIFAM, settings, damping=damping).gain == pytest.approx(other.stiffness, rel=1e-6)


@pytest.mark.parametrize("estimator", [AveragedDifference(7), STOCK, KalmanVelocity(3.0)])
def test_the_filter_of_an_estimator_is_the_estimator(estimator, rng):
    # A thousand steps a sample: fine enough, and few enough edges to count.
    record = record_motion(Encoder(1e-9), np.cumsum(rng.normal(size=400)) * 1e-6, interval=1e-3, samples_apart=1)
    filter_ = velocity_filter(estimator, step=1e-9, period=1e-3)
    a, b = filter_.denominator, filter_.numerator
    v, x = estimate_velocity(estimator, record), record.reading
    past = slice(150, 400)
    left = sum(a[i] * v[150 - i : 400 - i] for i in range(len(a)))
    right = sum(b[i] * x[150 - i : 400 - i] for i in range(len(b)))
    assert v[past].any()
    np.testing.assert_allclose(left, right, rtol=0, atol=1e-9 * np.abs(v).max())


@pytest.mark.parametrize("estimator", [AveragedDifference(1), AveragedDifference(16), STOCK, KalmanVelocity(10.0)])
def test_simulated_virtual_damping_fails_where_the_linear_loop_does(estimator):
    settings = LoopSettings(estimator=estimator)
    linear = critical_damping_gain(TIP, settings).gain
    assert simulated_damping_gain(TIP, settings, low=0.3 * linear, high=3 * linear) == pytest.approx(linear, rel=0.03)


def test_virtual_damping_of_a_mass_is_that_of_its_lag():
    """Phase of an integrator and a pure lag: B = m pi / (2 lag), over what the average leaves at that frequency."""
    lag = 50e-3 + 0.5e-3  # and half a period of the hold
    average = 2 / math.pi  # what a moving average leaves at the frequency whose half cycle is its length
    measured = critical_damping_gain(TIP, LoopSettings(estimator=STOCK)).gain
    assert measured == pytest.approx(TIP.mass * math.pi / (2 * lag) / average, rel=0.02)


def test_a_shorter_lag_allows_more_virtual_damping():
    stock = critical_damping_gain(TIP, LoopSettings(estimator=STOCK)).gain
    improved = critical_damping_gain(TIP, LoopSettings(estimator=IMPROVED)).gain
    assert improved / stock == pytest.approx(5.68, abs=0.01)


def test_period_measurement_swings_below_its_linear_limit():
    """The wait for edges at low speed is lag, so that a swing of some steps lasts."""
    settings = LoopSettings(estimator=IMPROVED)
    linear = critical_damping_gain(TIP, settings).gain
    found = simulated_damping_gain(TIP, settings, low=0.1, high=100.0)
    assert 0.4 * linear < found < 0.8 * linear


def test_adaptive_window_bears_more_virtual_damping_than_the_average_of_its_length():
    stock = simulated_damping_gain(TIP, LoopSettings(estimator=STOCK), low=0.1, high=1000.0)
    adaptive = simulated_damping_gain(TIP, LoopSettings(estimator=AdaptiveWindow(100)), low=0.1, high=1000.0)
    assert adaptive > 10 * stock


def test_simulated_wall_fails_where_the_linear_loop_does():
    linear = critical_wall(DAMPED, LoopSettings()).gain
    assert swinging_from(partial(simulate_wall, DAMPED, LoopSettings()), low=200.0, high=20e3) == pytest.approx(
        linear, rel=0.03
    )


@pytest.mark.parametrize("estimator", [AveragedDifference(1), KalmanVelocity(10.0)])
def test_simulated_wall_with_damping_fails_where_the_linear_loop_does(estimator):
    settings = LoopSettings(estimator=estimator)
    linear = critical_wall(DAMPED, settings, damping=3.0).gain
    found = swinging_from(
        partial(simulate_wall, DAMPED, settings, damping=3.0, push=5.0), low=0.2 * linear, high=5 * linear
    )
    # A swing that leaves the wall for part of its cycle is no longer linear.
    assert found == pytest.approx(linear, rel=0.08)


def test_a_pressed_wall_gives_way_by_force_over_stiffness():
    trace = simulate_wall(DAMPED, LoopSettings(), 1000.0, push=1.0)
    assert trace.position[-1, 0] == pytest.approx(1e-3, abs=LoopSettings().encoder.step)


def test_adaptive_windowing_is_no_filter():
    with pytest.raises(ParameterError, match="simulate the loop instead"):
        critical_damping_gain(TIP, LoopSettings(estimator=AdaptiveWindow()))


HELD = DAMPED.held_by(Operator(0.1, 2.0, 50.0))


def test_equal_devices_bear_half_the_gain_of_one_on_a_wall():
    wall = critical_wall(DAMPED, LoopSettings()).gain
    assert critical_loop_gain(DAMPED, DAMPED, LoopSettings()).gain == pytest.approx(wall / 2, rel=1e-9)


@pytest.mark.parametrize("master", [DAMPED, HELD], ids=["free", "held"])
def test_simulated_loop_gain_is_the_linear_one(master):
    linear = critical_loop_gain(master, DAMPED, LoopSettings()).gain
    run = partial(simulate_teleoperation, master, DAMPED, LoopSettings())
    assert swinging_from(run, low=10.0, high=1e5) == pytest.approx(linear, rel=0.04)


@pytest.mark.parametrize("estimator", [AveragedDifference(1), KalmanVelocity(10.0)])
def test_simulated_loop_gain_with_damping_is_the_linear_one(estimator):
    settings = LoopSettings(estimator=estimator)
    linear = critical_loop_gain(DAMPED, DAMPED, settings, damping=5.0).gain
    found = swinging_from(partial(simulate_teleoperation, DAMPED, DAMPED, settings, damping=5.0), low=10.0, high=1e5)
    assert found == pytest.approx(linear, rel=0.04)


def test_too_much_damping_of_a_late_estimate_leaves_no_gain():
    late = LoopSettings(estimator=AveragedDifference(100))
    assert critical_loop_gain(DAMPED, DAMPED, late, damping=5.0).gain == 0.0


def test_forces_on_both_devices_are_opposite():
    trace = simulate_teleoperation(DAMPED, DAMPED, LoopSettings(), 200.0, damping=1.0)
    np.testing.assert_array_equal(trace.force[:, 0], -trace.force[:, 1])


def test_devices_meet_in_the_middle():
    trace = simulate_teleoperation(DAMPED, DAMPED, LoopSettings(), 200.0, damping=1.0, offset=2e-3)
    np.testing.assert_allclose(trace.position[-1], 1e-3, atol=LoopSettings().encoder.step)


@pytest.mark.parametrize(
    ("axis", "gain"), [(PHANTOM_1_5_X, 0.0), (PHANTOM_1_5_Y, 0.0), (PHANTOM_1_5_Z, math.inf)], ids=["x", "y", "z"]
)
def test_the_published_fits_have_no_loop_gain_to_compare(axis, gain):
    assert critical_loop_gain(axis, axis, LoopSettings()).gain == gain


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
