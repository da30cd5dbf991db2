"""Numbers behind play and compliance. Oracle: closed forms of a free flight, of two masses on a spring, of rounding."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.transmission.backlash import Backlash, play
from phantom_dyn.effects.transmission.transmission_compliance import (
    TransmissionCompliance,
    _edge,
    _followed,
    moving_mass,
)
from phantom_dyn.motion import Motion

BACKLASH, COMPLIANCE = Backlash(), TransmissionCompliance()
EDGES = (8.0, 12.0, 20.0)
RATE = 500.0


@pytest.fixture
def falling(planar) -> Operation:
    """The elbow at rest near its hanging position, held there by a torque that passes zero as a straight line."""
    t = np.arange(400) / RATE
    q = np.column_stack([0 * t, 0.02 * (t - 0.401)])
    return Operation.of(replace(planar, coulomb_friction=np.zeros(2)), Motion(t, q, 0 * q, 0 * q))


def test_gaps_that_are_tried_are_crossed_in_eight_to_sixty_milliseconds(planar, falling):
    # Closed form: under a pull that grows by s a second a link falls s T^3 / 6; here s = m g l q' / I.
    inertia = falling.partials[2][0, 1, 1] - 0.1
    growth = 1.5 * 9.81 * 0.2 * 0.02 / inertia
    gaps = [gap for (gap,) in BACKLASH.shapes(planar, falling, "elbow")]
    assert gaps[0] == pytest.approx(growth * 0.008**3 / 6.0, rel=0.02)
    assert gaps[-1] == pytest.approx(growth * 0.060**3 / 6.0, rel=0.02)


def test_a_load_that_keeps_its_sign_tries_no_gap(planar):
    q = np.full((50, 2), 0.5)
    held = Operation.of(planar, Motion(np.arange(50) / RATE, q, 0 * q, 0 * q))
    assert BACKLASH.shapes(planar, held, "elbow") == ()


def test_a_link_is_behind_its_motor_by_the_lead_of_the_play(planar, falling):
    # The link is ahead by minus what the motor leads, on its own joint alone.
    inertia = falling.partials[2][:, 1, 1] - 0.1
    lead = play(falling.t, falling.transmitted[:, 1] / inertia, 1e-6).lead
    assert lead.min() < 0 < lead.max()
    smooth = replace(falling, robot=replace(falling.robot, viscous_friction=np.zeros(2)))
    np.testing.assert_allclose(BACKLASH.link_ahead(smooth, "elbow", np.array([1e-6]))[:, 1], -lead)
    assert not BACKLASH.link_ahead(smooth, "elbow", np.array([1e-6]))[:, 0].any()


def test_rotor_and_link_swing_with_the_harmonic_mean_of_their_inertias(planar):
    # Closed form of two masses: J l / (J + l); stretched out the last link has m l^2 + I about its joint.
    link = float(planar.model.inertias[2].inertia[1, 1]) + 1.5 * 0.2**2
    assert moving_mass(planar, 1) == pytest.approx(0.1 * link / (0.1 + link))


def test_a_simulated_play_ends_on_springs_that_swing_at_120_hertz(planar):
    # Closed form: k = m w^2, and 2 zeta m w with a damping ratio of 0.7.
    ends, mass, w = (
        BACKLASH.simulated(planar, "elbow", np.array([0.01])).transmission,
        moving_mass(planar, 1),
        240 * np.pi,
    )
    assert ends is not None
    assert (ends.joint, ends.gap) == ("elbow", 0.01)
    assert ends.stiffness == pytest.approx(mass * w**2)
    assert ends.damping == pytest.approx(1.4 * mass * w)


def test_a_simulated_spring_has_a_damping_ratio_of_a_twentieth(planar):
    spring = COMPLIANCE.simulated(planar, "elbow", np.array([500.0])).transmission
    assert spring is not None
    assert (spring.stiffness, spring.gap) == (500.0, 0.0)
    assert spring.damping == pytest.approx(0.1 * np.sqrt(500.0 * moving_mass(planar, 1)))


def test_a_compliance_may_be_off_its_shape_as_far_as_to_the_next_frequency(planar):
    ((low, high),) = COMPLIANCE.coefficient_bounds(planar, "elbow", (1e-3,))
    assert (low, high) == pytest.approx((0.4e-3, 2.5e-3))


def test_without_a_stated_step_the_load_ends_at_the_middle_edge():
    assert _edge(np.arange(100) / RATE, np.ones(100), 0.1, None, EDGES) == 12.0


@pytest.mark.parametrize("crossing", [10.0, 15.0])
def test_the_load_ends_where_rounding_has_half_its_amplitude(rng, crossing):
    # Closed form: rounding to h has the density h^2 / (6 rate) in place and (I w^2)^2 of it in torque; the power of the
    # load is white, four times the rounding's at the frequency sought.
    t, inertia, step = np.arange(60000) / RATE, 0.3, 1e-4
    density = 4.0 * (inertia * step * (2 * np.pi * crossing) ** 2) ** 2 / (6.0 * RATE)
    load = rng.normal(size=len(t)) * np.sqrt(density * RATE / 2.0)
    assert _edge(t, load, inertia, step, EDGES) == pytest.approx(crossing, abs=1.0)


@pytest.mark.parametrize(("size", "edge"), [(1e-12, 8.0), (1e3, 20.0)])
def test_the_load_ends_between_the_outer_edges_however_loud_it_is(rng, size, edge):
    # Lines of the spectrum are half a hertz apart.
    t = np.arange(20000) / RATE
    assert _edge(t, size * rng.normal(size=len(t)), 0.3, 1e-4, EDGES) == pytest.approx(edge, abs=0.5)


@pytest.mark.parametrize(("samples", "edge", "pad"), [(16, 10.0, 15), (40, 60.0, 25), (90, 20.01, 74), (40, 200.0, 7)])
def test_a_load_is_followed_by_a_filter_of_second_order_without_delay(rng, samples, edge, pad):
    # SciPy's filter; by hand: padded by three periods of its edge, or all but one of the samples.
    t, load = 3.0 + np.arange(samples) / RATE, rng.normal(size=samples)
    expected = sosfiltfilt(butter(2, edge, fs=RATE, output="sos"), load, padlen=pad)
    np.testing.assert_allclose(_followed(t, load, edge), expected, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize(("samples", "edge"), [(15, 10.0), (40, 200.1)])
def test_few_samples_and_edges_above_two_fifths_of_the_rate_leave_a_load_as_it_is(rng, samples, edge):
    load = rng.normal(size=samples)
    assert _followed(np.arange(samples) / RATE, load, edge) is load


@pytest.mark.parametrize(("samples", "edge"), [(15, 12.0), (16, 20.0)])
def test_sixteen_samples_tell_how_far_a_load_goes(rng, samples, edge):
    t = np.arange(samples) / RATE
    assert _edge(t, 1e3 * rng.normal(size=samples), 0.3, 1e-4, EDGES) == edge


def test_lines_of_a_short_load_are_as_far_apart_as_it_lasts(rng):
    # By hand: forty samples of 500 Hz, lines 12.5 Hz apart, all lost above 8 Hz.
    t = 7.0 + np.arange(40) / RATE
    assert _edge(t, 1e-12 * rng.normal(size=40), 0.3, 1e-4, (8.0, 12.0, 90.0)) == pytest.approx(12.5)
