"""Transmissions: compliance, stiffness and springs."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline
from scipy.signal import butter, sosfiltfilt

from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.transmission.backlash import Backlash, play
from phantom_dyn.effects.transmission.parasitic_spring import ParasiticSpring
from phantom_dyn.effects.transmission.transmission_compliance import (
    TransmissionCompliance,
    _edge,
    _followed,
    moving_mass,
    swing,
)
from phantom_dyn.motion import Motion
from phantom_dyn.simulation.simulate import Cause, simulate

BACKLASH, COMPLIANCE = Backlash(), TransmissionCompliance()


def low_passed(x: np.ndarray, rate: float, edge: float = 25.0) -> np.ndarray:
    return np.asarray(sosfiltfilt(butter(4, edge, fs=rate, output="sos"), x, axis=0))


def recorded(robot, effect, theta, swinging):
    """What a recording of the arm shows in 25 Hz: the operation as read, and the torque beyond the model's."""
    controller, q0, v0 = swinging
    held = replace(robot, torque_hold="zoh")
    t = np.arange(0.0, 2.5, 2e-3)
    s = simulate(held, (Cause(effect, "elbow", theta),), controller, t, q0, v0, max_step=1e-3)
    # Velocity and acceleration from positions: sampled ones would alias the impacts. A held torque acts half a sample
    # late, so the mean of two is that of the sample.
    spline = make_interp_spline(t, low_passed(s.q, 500.0, 40.0), k=5)
    tau = 0.5 * (s.tau + np.vstack([s.tau[:1], s.tau[:-1]]))
    operation = Operation.of(held, Motion(t, spline(t), spline(t, 1), spline(t, 2)), tau)
    return operation, low_passed(tau - operation.tau, 500.0)[100:-100]


def agreement(predicted: np.ndarray, seen: np.ndarray) -> tuple[float, float]:
    """Correlation, and the factor that the prediction has to be scaled by."""
    inner = float(np.sum(predicted * seen))
    return inner / float(np.linalg.norm(predicted) * np.linalg.norm(seen)), inner / float(np.sum(predicted**2))


@pytest.mark.parametrize("gap", [0.003, 0.01])
def test_a_simulated_backlash_leaves_the_torque_that_the_law_says(planar, swinging, gap):
    # Oracle: the two-mass simulation, which knows nothing of loose phases and impacts.
    operation, seen = recorded(planar, BACKLASH, np.array([gap]), swinging)
    law = BACKLASH.torque(planar, operation, "elbow", np.array([gap]))
    correlation, scale = agreement(-low_passed(law, 500.0)[100:-100], seen)
    assert correlation > 0.95
    assert scale == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("stiffness", [200.0, 600.0])
def test_a_simulated_spring_leaves_the_torque_that_the_law_says(frictionless, swinging, stiffness):
    # The recording begins in motion, of which the law cannot know how the spring was bent: it has to fade first.
    operation, seen = recorded(frictionless, COMPLIANCE, np.array([stiffness]), swinging)
    law = COMPLIANCE.torque(frictionless, operation, "elbow", np.array([stiffness]))
    correlation, scale = agreement(-low_passed(law, 500.0)[500:-100], seen[400:])
    assert correlation > 0.97
    assert scale == pytest.approx(1.0, abs=0.05)


def test_a_link_crosses_its_gap_in_free_fall():
    # Closed form: pull -5 rad/s^2 from t = 0.1 s, gap 0.01 rad: landed after sqrt(2 x 0.01 / 5) s at 0.316 rad/s.
    t = np.arange(0.0, 0.4, 1e-4)
    moved = play(t, np.where(t < 0.1, 1.0, -5.0), 0.01)
    assert moved.loose.sum() * 1e-4 == pytest.approx(np.sqrt(0.004), rel=0.01)
    assert moved.impact.sum() * 1e-4 == pytest.approx(-np.sqrt(2 * 5 * 0.01), rel=0.01)
    assert moved.lead[0] == 0.005
    assert moved.lead[-1] == -0.005


def test_a_slow_load_deflects_a_spring_by_load_over_stiffness(planar):
    # Closed form: delta = -tl / k, far below the frequency of the swing.
    t = np.arange(0.0, 20.0, 1e-2)
    q = np.column_stack([0 * t, 0.5 * np.sin(0.3 * t)])
    operation = Operation.of(planar, Motion(t, q, 0 * q, 0 * q))
    delta = swing(operation, 1, 500.0)[0]
    hanging = 1.5 * 9.81 * 0.2 * np.sin(q[:, 1])
    np.testing.assert_allclose(delta[50:-50], -hanging[50:-50] / 500.0, atol=3e-2 * np.abs(hanging).max() / 500.0)


def test_the_column_of_a_spring_is_the_law_per_compliance_to_first_order(arm, smooth):
    stiffness = 1e6
    column = COMPLIANCE.signature(arm, smooth, "tilt", (1 / stiffness, 0.1)).columns[:, :, 0]
    law = COMPLIANCE.torque(arm, smooth, "tilt", np.array([stiffness]))
    np.testing.assert_allclose(law, -column / stiffness, atol=1e-3 * np.abs(law).max())


def test_the_column_of_a_gap_is_the_law(arm, smooth):
    column = BACKLASH.signature(arm, smooth, "tilt", (0.01,)).columns[:, :, 0]
    np.testing.assert_allclose(BACKLASH.torque(arm, smooth, "tilt", np.array([0.01])), -column)


def test_stiffness_is_one_over_the_coefficient(arm):
    assert COMPLIANCE.from_coefficients(arm, "tilt", np.array([1e-3]), (2e-3, 0.1)) == pytest.approx([1000.0])


@pytest.mark.parametrize("effect", [BACKLASH, COMPLIANCE], ids=lambda effect: effect.name)
def test_an_encoder_on_the_link_sees_nothing_of_the_transmission(arm, smooth, effect):
    linked = replace(arm, actuators=tuple(replace(one, encoder_side="link") for one in arm.actuators))
    assert "the encoder sits on the link's side" in str(effect.untestable(linked, smooth, "tilt"))
    assert effect.untestable(arm, smooth, "tilt") is None


@pytest.mark.parametrize("effect", [BACKLASH, COMPLIANCE], ids=lambda effect: effect.name)
def test_shapes_are_positive_and_refined_about_the_last(arm, smooth, effect):
    shapes = effect.shapes(arm, smooth, "tilt")
    assert min(shapes)[0] > 0
    assert any(shape == pytest.approx(shapes[0]) for shape in effect.refined(np.array(shapes[0]), shapes[0]))


def test_a_compliance_is_sought_about_its_shape_however_high_its_resonance_comes_out():
    # A coefficient of twice the shape says that the link swings twice as far there, not that it swings more slowly.
    shapes = [compliance for compliance, damping in COMPLIANCE.refined(np.array([2e-3]), (1e-3, 0.1)) if damping == 0.1]
    assert sorted(shapes) == pytest.approx([0.75e-3, 0.9e-3, 1e-3, 1.11e-3, 1.33e-3, 2e-3])


def test_the_damping_of_a_spring_is_sought_between_half_a_per_cent_and_a_third():
    tried = [
        damping for compliance, damping in COMPLIANCE.refined(np.array([2e-3]), (1e-3, 0.01)) if compliance == 1e-3
    ]
    assert sorted(tried) == pytest.approx([0.007, 0.01, 0.014, 0.025])


EDGES = (8.0, 12.0, 20.0)

RATE = 500.0


@pytest.fixture
def falling(planar) -> Operation:
    """The elbow at rest near its hanging position, held there by a torque that passes zero as a straight line."""
    t = np.arange(400) / RATE
    q = np.column_stack([0 * t, 0.02 * (t - 0.401)])
    return Operation.of(replace(planar, coulomb_friction=np.zeros(2)), Motion(t, q, 0 * q, 0 * q))


def test_gaps_are_tried_from_what_is_crossed_in_eight_milliseconds(planar, falling):
    # Closed form: under a pull that grows by s a second a link falls s T^3 / 6; here s = m g l v / I at 20 rad/s.
    fast = Operation.of(falling.robot, Motion(falling.t, 1000.0 * falling.q, 0 * falling.q, 0 * falling.q))
    inertia = fast.partials[2][0, 1, 1] - 0.1
    near = np.abs(fast.q[:, 1]) < 0.1
    assert near.sum() > 2
    growth = 1.5 * 9.81 * 0.2 * 20.0 / inertia
    gaps = [gap for (gap,) in BACKLASH.shapes(planar, fast, "elbow")]
    assert gaps[0] == pytest.approx(growth * 0.008**3 / 6.0, rel=0.1)


def test_gaps_are_tried_between_two_seconds_of_arc_and_what_a_hand_notices(planar, falling):
    # A torque that passes zero slowly lets a link fly for long: its gap is sought up to the widest that is plausible.
    gaps = np.array([gap for (gap,) in BACKLASH.shapes(planar, falling, "elbow")])
    assert gaps[0] == pytest.approx(1e-5)
    assert 0.1 / 1.7 < gaps[-1] <= 0.1
    np.testing.assert_allclose(gaps[1:] / gaps[:-1], 1.7)


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


def test_a_link_on_a_soft_spring_hardly_follows_a_jerk_of_its_motor(planar):
    # Closed form: a jerk within 5 ms is over before a link that swings five times a second has begun to move.
    fine = replace(planar, actuators=tuple(replace(one, encoder_counts=2**24) for one in planar.actuators))
    t = np.arange(4000) / 2000.0
    x = (t - 1.0) / 0.005
    jerk = 1e-3 * np.exp(-(x**2))[:, None] * [0.0, 1.0]
    v, a = -2.0 * x[:, None] / 0.005 * jerk, (4.0 * x[:, None] ** 2 - 2.0) / 0.005**2 * jerk
    operation = Operation.of(fine, Motion(t, jerk, v, a))
    inertia = operation.inertia[:, 1] - fine.rotor_inertia[1]
    stiffness = float(np.median(inertia)) * (2.0 * np.pi * 5.0) ** 2
    torque = COMPLIANCE.torque(fine, operation, "elbow", np.array([stiffness]))[:, 1]
    np.testing.assert_allclose(torque, inertia * a[:, 1], atol=0.05 * np.abs(inertia * a[:, 1]).max())


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


def test_the_torque_is_minus_k_times_the_way_from_rest(arm, operation):
    # Contract: -k (q - q0).
    torque = ParasiticSpring().torque(arm, operation, "tilt", np.array([4.0, 0.25]))
    np.testing.assert_array_equal(torque[:, 1], -4.0 * (operation.q[:, 1] - 0.25))


@pytest.mark.parametrize("coefficients", [(0.0, 0.0), (0.0, 1e5), (1e-310, -1e5)])
def test_a_spring_without_stiffness_has_a_finite_rest_position(arm, coefficients):
    theta = ParasiticSpring().from_coefficients(arm, "tilt", np.array(coefficients), ())
    assert np.all(np.isfinite(theta**2))


def test_a_spring_that_pushes_away_has_a_rest_position_too(arm):
    # By hand: -4 (q - 0.25) = -4 q + 1.
    theta = ParasiticSpring().from_coefficients(arm, "tilt", np.array([-4.0, 1.0]), ())
    np.testing.assert_allclose(theta, [-4.0, 0.25])


def test_a_spring_is_probed_and_sized_about_the_posture(arm, operation):
    # By hand: one unit of stiffness at rest in the mean position.
    name, direction = ParasiticSpring().probe(arm, operation, "tilt")
    assert name == "stiffness"
    np.testing.assert_allclose(direction, [1.0, -operation.q[:, 1].mean()])
    assert ParasiticSpring().sized(arm, "tilt", "stiffness", 3.0, np.array([0.1, 0.2, 0.3])) == (3.0, 0.2)


def test_a_spring_pulls_back_to_any_position(arm):
    assert ParasiticSpring().coefficient_bounds(arm, "tilt", ()) == ((0.0, np.inf), (-np.inf, np.inf))
