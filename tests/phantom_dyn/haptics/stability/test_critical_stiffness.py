"""Critical stiffness of a wall: sampled loop, linear condition, map."""

import math
from dataclasses import replace

import control
import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.signal import butter, dlsim

from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.device.axis import YOKOKOHJI_YOSHIKAWA, Operator, RigidAxis, TwoMassAxis
from phantom_dyn.haptics.device.discretisation import discretise
from phantom_dyn.haptics.device.published import (
    LHIFAM,
    LHIFAM_HEAVIER_MOTOR,
    LHIFAM_NEW_CABLE,
    PHANTOM_1_5_X,
    PHANTOM_1_5_Y,
    PHANTOM_1_5_Z,
    phantom_1_0,
)
from phantom_dyn.haptics.stability.critical_stiffness import (
    critical_stiffness,
    linear_ratio,
    linear_stiffness,
    loop_bode,
    stability_map,
)
from phantom_dyn.haptics.stability.sampled_loop import DigitalFilter, SampledLoop, critical_gain

T = 1e-3

ORIGINAL = replace(LHIFAM, cable_damping=13.82)

SOFT_MODE = TwoMassAxis(0.001, 0.05, 0.01, 0.0, 500.0, 0.02)


def below_nyquist(found):
    return [crossing for crossing in found.crossings if crossing.frequency < 0.999 * math.pi / T]


def test_gain_margin_and_its_frequency_are_those_of_python_control():
    s = LHIFAM_NEW_CABLE.state_space
    sampled = control.c2d(control.ss(s.A, s.B[:, None], s.C[None], 0), T)
    frequency = brentq(lambda w: complex(sampled(np.exp(1j * w * T))).imag, 300.0, 600.0)
    found = critical_stiffness(LHIFAM_NEW_CABLE, period=T)
    assert found.frequency == pytest.approx(frequency, rel=1e-6)
    assert found.stiffness == pytest.approx(-1 / complex(sampled(np.exp(1j * frequency * T))).real, rel=1e-6)


@pytest.mark.parametrize("delay", [0.0, 0.25e-3, 1e-3, 2e-3, 4e-3, 8e-3])
@pytest.mark.parametrize("axis", [ORIGINAL, LHIFAM_NEW_CABLE, SOFT_MODE], ids=["original", "new", "soft"])
def test_spectral_radius_is_one_at_the_critical_stiffness(axis, delay):
    found, sampled = critical_stiffness(axis, period=T, delay=delay), discretise(axis, period=T, delay=delay)
    assert sampled.spectral_radius(found.stiffness) == pytest.approx(1.0, abs=1e-8)
    assert found.radius_below < 1 < found.radius_above
    assert found.verified


@pytest.mark.parametrize("virtual_damping", [0.5, 2.0])
def test_a_rigid_device_without_damping_has_a_closed_form(virtual_damping):
    # Jury on (z-1)^2 z + (T^2/2m)(z+1)(K z + (B/T)(z-1)): by numpy's roots of that polynomial.
    m = 1.0
    found = critical_stiffness(RigidAxis(m, 0.0), period=T, virtual_damping=virtual_damping).stiffness
    for factor, stable in ((0.9999, True), (1.0001, False)):
        K, rate, half = factor * found, virtual_damping / T, T**2 / (2 * m)
        polynomial = np.polymul([1, -2, 1], [1, 0]) + half * np.concatenate(
            [[0], np.polymul([1, 1], [K + rate, -rate])]
        )
        assert (np.abs(np.roots(polynomial)).max() < 1) == stable


def test_original_cable_has_three_crossings():
    # 38.52, 100.9 and 595 rad/s at 78.89, 103.6 and 89.9 dB; the vibration is not the lowest.
    found = critical_stiffness(ORIGINAL, period=T)
    assert found.stiffness == pytest.approx(8804, abs=0.5)
    assert [c.frequency for c in below_nyquist(found)] == pytest.approx([38.52, 100.9, 595.0], rel=1e-3)
    assert [c.decibels for c in below_nyquist(found)] == pytest.approx([78.89, 103.6, 89.9], abs=0.05)


def test_linear_condition_of_the_lhifam_is_7000_newton_per_metre():
    assert linear_stiffness(ORIGINAL.rigid.damping, period=T) == pytest.approx(7000)
    assert 20 * math.log10(7000) == pytest.approx(76.90, abs=5e-3)


def test_new_cable_has_a_single_higher_crossing():
    # Printed 411.23 rad/s; the masses that follow from the printed resonance give 445.06 rad/s and 87.74 dB.
    found = critical_stiffness(LHIFAM_NEW_CABLE, period=T)
    assert len(below_nyquist(found)) == 1
    assert found.frequency == pytest.approx(445.06, abs=0.01)
    assert found.stiffness == pytest.approx(24372, abs=1)
    assert found.decibels == pytest.approx(87.74, abs=5e-3)
    assert found.frequency == pytest.approx(411.23, rel=0.10)
    assert found.stiffness > critical_stiffness(ORIGINAL, period=T).stiffness


def test_a_heavier_motor_gives_the_printed_crossing():
    # Printed 411.23 rad/s.
    found = critical_stiffness(LHIFAM_HEAVIER_MOTOR, period=T)
    assert found.frequency == pytest.approx(411.23, abs=0.05)
    assert found.decibels == pytest.approx(87.84, abs=0.01)


@pytest.mark.parametrize(("damping", "crossings"), [(3.2, 1), (7.5, 1)])
def test_damping_of_the_body_that_the_source_allows_leaves_one_crossing_with_the_new_cable(damping, crossings):
    found = critical_stiffness(replace(LHIFAM_NEW_CABLE, body_damping=damping), period=T)
    assert len(below_nyquist(found)) == crossings


def test_less_damping_of_the_body_brings_the_low_crossing_back():
    assert len(below_nyquist(critical_stiffness(replace(LHIFAM_NEW_CABLE, body_damping=3.1), period=T))) == 3


def test_more_damping_of_the_body_loses_the_low_crossing_of_the_original_cable():
    assert len(below_nyquist(critical_stiffness(replace(ORIGINAL, body_damping=7.65), period=T))) == 3
    assert len(below_nyquist(critical_stiffness(replace(ORIGINAL, body_damping=7.8), period=T))) == 1


def test_crossing_does_not_depend_on_the_damping_of_the_body():
    other = critical_stiffness(replace(LHIFAM_NEW_CABLE, body_damping=7.0), period=T)
    assert other.frequency == pytest.approx(445.06, rel=2e-3)


# Delay [ms]: frequency [rad/s and Hz], margin [dB], critical stiffness, linear condition [N/m].
SWEEP = [
    (0, 445.06, 70.83, 87.74, 24372, 7000),
    (1, 21.60, 3.44, 68.56, 2677.9, 2333),
    (2, 16.43, 2.62, 63.58, 1510.4, 1400),
    (3, 13.79, 2.20, 60.46, 1053.9, 1000),
    (4, 12.12, 1.93, 58.17, 809.8, 777.8),
    (5, 10.94, 1.74, 56.36, 657.6, 636.4),
    (6, 10.05, 1.60, 54.86, 553.6, 538.5),
    (7, 9.35, 1.49, 53.59, 478.0, 466.7),
    (8, 8.77, 1.40, 52.48, 420.7, 411.8),
]


@pytest.mark.parametrize(("delay", "frequency", "hertz", "decibels", "stiffness", "linear"), SWEEP)
def test_delay_sweep(delay, frequency, hertz, decibels, stiffness, linear):
    found = critical_stiffness(LHIFAM_NEW_CABLE, period=T, delay=delay * T)
    assert found.frequency == pytest.approx(frequency, abs=6e-3)
    assert found.frequency / (2 * math.pi) == pytest.approx(hertz, abs=6e-3)
    assert found.decibels == pytest.approx(decibels, abs=6e-3)
    assert found.stiffness == pytest.approx(stiffness, rel=5e-5, abs=0.06)
    assert linear_stiffness(3.5, period=T, delay=delay * T) == pytest.approx(linear, rel=2e-4)


def test_an_inherent_delay_of_250_microseconds_is_not_worth_seven_decibels():
    # Printed: more than 7 dB. Found: 11.2 dB at the low crossing, 3.4 dB at that of the vibration.
    prompt = critical_stiffness(LHIFAM_NEW_CABLE, period=T)
    late = critical_stiffness(LHIFAM_NEW_CABLE, period=T, delay=0.25e-3)
    low, _, high = below_nyquist(late)
    assert (low.decibels, low.frequency) == (pytest.approx(76.56, abs=6e-3), pytest.approx(32.8, abs=0.05))
    assert (high.decibels, high.frequency) == (pytest.approx(84.37, abs=6e-3), pytest.approx(416.9, abs=0.06))
    assert prompt.decibels - low.decibels == pytest.approx(11.2, abs=0.05)
    assert prompt.decibels - high.decibels == pytest.approx(3.4, abs=0.05)


@pytest.mark.parametrize(("delay", "frequency"), [(0.30e-3, 413.0), (0.40e-3, 407.0)])
def test_a_delay_that_gives_the_printed_crossing_brings_the_low_one_back(delay, frequency):
    crossings = below_nyquist(critical_stiffness(LHIFAM_NEW_CABLE, period=T, delay=delay))
    assert len(crossings) == 3
    assert crossings[-1].frequency == pytest.approx(frequency, abs=0.5)


@pytest.mark.parametrize(("damping", "stiffness"), [(0.001, 18.9), (0.002, 22.1), (0.004, 26.8), (0.008, 35.9)])
def test_phantom_depends_on_the_lost_damping_of_its_cable(damping, stiffness):
    assert critical_stiffness(phantom_1_0(damping), period=T).stiffness == pytest.approx(stiffness, abs=0.05)


def test_linear_condition_of_the_phantom():
    linear = linear_stiffness(phantom_1_0(0.001).rigid.damping, period=T)
    assert linear == pytest.approx(17.0, abs=0.05)
    assert linear / 0.12**2 == pytest.approx(1180, abs=1)


@pytest.mark.parametrize(
    ("axis", "delay", "virtual_damping", "ratio"),
    [
        (RigidAxis(5.4, 3.5), 0.0, 0.0, 1.0001),
        (RigidAxis(5.4, 3.5), 8e-3, 0.0, 1.0009),
        (RigidAxis(5.4, 3.5), 0.0, 20.0, 0.996),
        (RigidAxis(0.073, 0.59), 0.0, 5.0, 0.935),
        (RigidAxis(0.073, 0.59), 0.0, 20.0, 0.761),
    ],
)
def test_linear_condition_against_the_exact_boundary(axis, delay, virtual_damping, ratio):
    found = linear_ratio(axis, period=T, delay=delay, virtual_damping=virtual_damping)
    assert found == pytest.approx(ratio, abs=5e-4)


def test_linear_ratio_of_two_masses_takes_them_for_one():
    assert linear_ratio(LHIFAM_NEW_CABLE, period=T) == pytest.approx(24372 / 7000, rel=1e-4)


@pytest.mark.parametrize(("axis", "stiffness"), [(PHANTOM_1_5_X, 0.0), (PHANTOM_1_5_Y, 0.0), (PHANTOM_1_5_Z, math.inf)])
def test_published_fits_of_the_phantom_say_nothing_about_walls(axis, stiffness):
    # Derived: x and y are unstable with every wall, z is stable with every wall; none gives 2.0 or 2.7 N/mm.
    found = critical_stiffness(axis, period=T)
    assert found.stiffness == stiffness
    assert found.verified
    radii = [discretise(axis, period=T).spectral_radius(K) for K in np.geomspace(1e-3, 100, 26)]
    assert all((radius < 1) == math.isinf(stiffness) for radius in radii)


def test_a_device_without_damping_has_no_stable_wall():
    found = critical_stiffness(RigidAxis(1.0, 0.0), period=T)
    assert found.stiffness == 0.0
    assert found.decibels == -math.inf
    assert found.verified


def test_a_hand_stabilises_the_wall():
    held = critical_stiffness(LHIFAM_NEW_CABLE.held_by(YOKOKOHJI_YOSHIKAWA), period=T, delay=4e-3)
    assert held.verified
    assert held.stiffness > 1.5 * critical_stiffness(LHIFAM_NEW_CABLE, period=T, delay=4e-3).stiffness


def test_too_much_virtual_damping_leaves_no_stable_wall():
    assert critical_stiffness(SOFT_MODE, period=T, virtual_damping=10.0).stiffness == 0.0


def test_bode_diagram_holds_response_and_margin():
    found = loop_bode(LHIFAM_NEW_CABLE, period=T)
    at = int(np.argmin(np.abs(found.frequency - found.margin.frequency)))
    assert found.decibels[at] == pytest.approx(-found.margin.decibels, abs=0.5)
    assert found.phase[at] == pytest.approx(-math.pi, abs=0.1)
    assert found.phase[0] == pytest.approx(-math.pi / 2, abs=0.1)  # the dampers to ground rule there
    assert found.linear == pytest.approx(7000)


def test_bode_diagram_of_a_fraction_has_no_linear_condition():
    assert math.isnan(loop_bode(PHANTOM_1_5_Z, period=T).linear)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        pytest.param(
            lambda: linear_stiffness(1.0, period=0.0), "sampling period of 0 s", id="linear condition of no period"
        ),
        pytest.param(
            lambda: SampledLoop((discretise(RIGID, period=1e-3), discretise(RIGID, period=2e-3))),
            "give all the same period and delay",
            id="devices of different periods",
        ),
        pytest.param(
            lambda: DigitalFilter(np.ones(1), np.array([0.0, 1.0])),
            "starts with 0",
            id="a filter that starts with zero below",
        ),
        pytest.param(
            lambda: DigitalFilter(np.array([np.nan]), np.ones(1)), "give finite coefficients", id="a filter with a gap"
        ),
        pytest.param(
            lambda: critical_gain(SampledLoop((discretise(RIGID, period=PERIOD),)), lowest=0.0),
            "lowest frequency is 0",
            id="a lowest frequency of nothing",
        ),
        pytest.param(
            lambda: stability_map(RigidAxis(1.0, 1.0), period=[1e-3], delay=[]),
            r"The delay of the map is .*: give a sequence of at least one number",
            id="an empty axis",
        ),
        pytest.param(
            lambda: stability_map(RigidAxis(1.0, 1.0), period=[1e-3], delay=[-1e-3]),
            "a delay of 0 or more",
            id="a negative delay",
        ),
    ],
)
def test_what_cannot_be_is_refused(call, message):
    with pytest.raises(ParameterError, match=message):
        call()


PERIOD = 1e-3

RIGID = RigidAxis(5.4, 3.5)

TWO_MASS = TwoMassAxis(0.318, 5.082, 0.1, 3.4, 38e3, 11.0)

AVERAGE = DigitalFilter(np.concatenate([[1.0], np.zeros(9), [-1.0]]) / (10 * PERIOD), np.ones(1))


@pytest.mark.parametrize("delay", [0.0, 0.4e-3, 1e-3, 2.7e-3])
@pytest.mark.parametrize("scaled", [DigitalFilter(np.ones(1), np.ones(1)), DigitalFilter(*butter(2, 0.2)), AVERAGE])
def test_spectral_radius_passes_one_at_the_critical_gain(delay, scaled):
    axis = TWO_MASS.held_by(Operator(0.1, 1.0, 100.0))
    fixed = DigitalFilter(np.array([1.0, -1.0]) / PERIOD, np.ones(1))
    loop = SampledLoop((discretise(axis, period=PERIOD, delay=delay),), scaled, fixed)
    gain = critical_gain(loop).gain
    assert loop.spectral_radius(0.999 * gain) < 1 < loop.spectral_radius(1.001 * gain)


def test_lowest_margin_is_that_of_python_control():
    plant = discretise(RIGID, period=PERIOD)
    b, a = butter(2, 0.2)
    system = control.StateSpace(plant.transition, plant.newer[:, None], plant.output[None, :], 0, PERIOD)
    margins = control.stability_margins(system * control.TransferFunction(b, a, PERIOD), returnall=True, method="frd")
    assert critical_gain(SampledLoop((plant,), DigitalFilter(b, a))).gain == pytest.approx(min(margins[0]), rel=1e-5)


def test_closed_loop_steps_as_device_and_filter_do(rng):
    """One step of the matrix against the two recursions written out, under a delay of 1.3 periods."""
    plant = discretise(RIGID, period=PERIOD, delay=1.3e-3)
    b, a = butter(2, 0.2)
    loop = SampledLoop((plant,), DigitalFilter(b, a))
    x = rng.normal(size=2)
    forces = rng.normal(size=2)
    filtered_state = rng.normal(size=2)
    step = loop.closed_loop(100.0) @ np.concatenate([x, forces, filtered_state])
    A, B, C, D = loop.scaled.matrices()
    y = plant.output @ x
    u = -100.0 * (C @ filtered_state + D * y)
    expected = plant.transition @ x + plant.newer * forces[0] + plant.older * forces[1]
    np.testing.assert_allclose(step, [*expected, u, forces[0], *(A @ filtered_state + B * y)], rtol=1e-12)


def test_response_of_a_filter_is_that_of_its_matrices():
    filter_ = DigitalFilter(*butter(3, 0.1))
    A, B, C, D = filter_.matrices()
    _, impulse, _ = dlsim((A, B[:, None], C[None, :], D, PERIOD), np.eye(1, 4000)[0])
    w = np.array([10.0, 300.0])
    direct = (impulse[:, 0] * np.exp(-1j * w[:, None] * PERIOD * np.arange(4000))).sum(axis=1)
    np.testing.assert_allclose(filter_.response(w, PERIOD), direct, rtol=1e-9)


def test_an_undamped_device_bears_no_wall():
    assert critical_gain(SampledLoop((discretise(RigidAxis(1.0, 0.0), period=PERIOD),))).gain == 0.0


def test_the_gain_on_the_unit_circle_is_the_critical_gain():
    loop = SampledLoop((discretise(RIGID, period=PERIOD, delay=2e-3),))
    result = critical_gain(loop)
    assert loop.gain_on_unit_circle(np.array([result.frequency]))[0] / result.gain == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("axis", [LHIFAM_NEW_CABLE, SOFT_MODE, RigidAxis(0.07, 0.5)], ids=["lhifam", "soft", "rigid"])
def test_every_point_is_that_of_the_single_search(axis):
    values = {
        "period": [0.5e-3, 1e-3],
        "delay": [0.0, 0.3e-3, 2e-3],
        "damping": [0.0, 3.0],
        "virtual_damping": [-0.005, 0.0, 0.1, 5.0],
    }
    found = stability_map(axis, **values)
    for (i, j, k, m), stiffness in np.ndenumerate(found.stiffness):
        device = axis.damped(values["damping"][i])
        single = critical_stiffness(
            device,
            period=values["period"][m],
            delay=values["delay"][k],
            virtual_damping=values["virtual_damping"][j],
        )
        assert single.verified
        assert stiffness == pytest.approx(single.stiffness, rel=1e-8)


def test_shape_is_that_of_the_four_axes():
    found = stability_map(RigidAxis(1.0, 1.0), period=[1e-3], delay=[0, 1e-3], damping=[0, 1, 2], virtual_damping=[0.0])
    assert found.stiffness.shape == found.frequency.shape == found.linear.shape == (3, 1, 2, 1)


def test_ratio_to_the_linear_condition_is_one_for_a_heavy_rigid_device():
    found = stability_map(RigidAxis(5.4, 3.5), period=[1e-3], delay=np.linspace(0, 8e-3, 5))
    np.testing.assert_allclose(found.ratio, 1.0, atol=1e-3)
