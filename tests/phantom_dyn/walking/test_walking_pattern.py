"""Walking of a point mass: divergent component, zero moment point, pattern, trajectories."""

# pyright: reportAttributeAccessIssue=false
import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp

from phantom_dyn.errors import ParameterError, RobotError
from phantom_dyn.walking import zmp
from phantom_dyn.walking.divergent_component import Profile, entry, forward_weights, holding_point, pendulum
from phantom_dyn.walking.footsteps import Gait, Joystick
from phantom_dyn.walking.pattern import foot_motion, pendulum_motion, plan_walk

OMEGA = 3.3

PROFILE = Profile(0.25, 0.8)

START, HOLD = np.array([0.1, -0.2]), np.array([0.3, 0.05])

XI, COM = np.array([0.15, -0.1]), np.array([0.12, -0.13])


def integrated(t):
    """Oracle: the pendulum by numerical integration."""

    def rate(time, state):
        p = START + (HOLD - START) * min(time / PROFILE.ramp, 1.0)
        return np.concatenate([state[2:], OMEGA**2 * (state[:2] - p)])

    begin = np.concatenate([COM, OMEGA * (XI - COM)])
    return solve_ivp(rate, (0, t[-1]), begin, t_eval=t, rtol=1e-11, atol=1e-12, max_step=0.01).y.T


def test_the_closed_form_is_the_integrated_pendulum():
    t = np.linspace(0, PROFILE.duration, 33)
    states, oracle = pendulum(t, PROFILE, (START, HOLD), XI, COM, OMEGA), integrated(t)
    np.testing.assert_allclose(states.com, oracle[:, :2], atol=1e-9)
    np.testing.assert_allclose(states.velocity, oracle[:, 2:], atol=1e-8)
    np.testing.assert_allclose(states.dcm, oracle[:, :2] + oracle[:, 2:] / OMEGA, atol=1e-8)


def test_the_acceleration_is_that_of_the_pendulum_and_does_not_jump_at_the_end_of_the_ramp():
    t = PROFILE.ramp + np.array([-1e-9, 0.0, 1e-9])
    states = pendulum(t, PROFILE, (START, HOLD), XI, COM, OMEGA)
    np.testing.assert_allclose(states.acceleration, OMEGA**2 * (states.com - states.zmp), atol=1e-13)
    np.testing.assert_allclose(np.diff(states.acceleration, axis=0), 0, atol=1e-6)


def test_the_forward_weights_give_the_divergent_component_at_the_end_and_sum_to_one():
    grow, first, last = forward_weights(PROFILE, OMEGA)
    end = pendulum(np.array([PROFILE.duration]), PROFILE, (START, HOLD), XI, COM, OMEGA)
    np.testing.assert_allclose(grow * XI + first * START + last * HOLD, end.dcm[0], atol=1e-12)
    assert grow + first + last == pytest.approx(1.0, abs=1e-12)


def test_phases_entered_as_stated_end_at_rest_over_the_last_point(rng):
    points, profiles = rng.normal(size=(4, 2)), (PROFILE, Profile(0.1, 0.5), Profile(0.3, 0.3), Profile(0.2, 0.9))
    alpha, beta = entry(points, profiles, OMEGA)
    xi, before = alpha * START + beta, START
    for point, profile in zip(points, profiles, strict=True):
        xi = pendulum(np.array([profile.duration]), profile, (before, point), xi, COM, OMEGA).dcm[0]
        before = point
    np.testing.assert_allclose(xi, points[-1], atol=1e-9)


def test_the_holding_point_leads_to_where_the_next_phases_can_be_entered(rng):
    onward = entry(rng.normal(size=(3, 2)), (PROFILE,) * 3, OMEGA)
    hold = holding_point(XI, START, PROFILE, onward, OMEGA)
    end = pendulum(np.array([PROFILE.duration]), PROFILE, (START, hold), XI, COM, OMEGA)
    np.testing.assert_allclose(end.dcm[0], onward[0] * hold + onward[1], atol=1e-12)


def test_periodic_stepping_in_place_has_the_published_offset():
    # Englsberger: with instant change of feet a distance d apart the component starts at d / (1 + exp(omega T)) inside.
    feet = np.array([[0.0, 0.1 * (-1) ** k] for k in range(12)])
    quick = Profile(1e-9, 0.8)
    alpha, beta = entry(feet, (quick,) * 12, OMEGA)
    inside = 0.1 - (alpha * -0.1 + beta[1])
    assert inside == pytest.approx(0.2 / (1 + np.exp(OMEGA * 0.8)), abs=1e-6)


PATTERN_OMEGA = 3.35

GAIT = Gait(foot_distance=0.17)


def pressed(*changes) -> Joystick:
    t, speed, turn, walking = (np.array(column) for column in zip(*changes, strict=True))
    return Joystick(t.astype(float), speed.astype(float), turn.astype(float), walking.astype(bool))


def landings(phases):
    return [phase.end for phase in phases if phase.swing is not None]


@pytest.mark.parametrize("stop", np.linspace(3.0, 4.6, 9))
def test_a_stop_at_any_time_ends_within_two_steps(stop):
    phases = plan_walk(pressed((0.2, 0.15, 0.1, True), (stop, 0.0, 0.0, False)), GAIT, 10.0, PATTERN_OMEGA)
    after = [time for time in landings(phases) if time > stop]
    assert len(after) <= 2
    assert after[-1] <= stop + 2 * GAIT.step_time + 1e-9


def test_after_a_stop_it_stands_still_between_feet_side_by_side():
    phases = plan_walk(pressed((0.2, 0.15, 0.1, True), (4.0, 0.0, 0.0, False)), GAIT, 12.0, PATTERN_OMEGA)
    last = phases[-1].landing
    assert last.left.heading == last.right.heading
    end = pendulum_motion(phases, np.array([11.99]), PATTERN_OMEGA)
    np.testing.assert_allclose(end.zmp[0], last.middle, atol=1e-12)
    np.testing.assert_allclose(end.com[0], last.middle, atol=1e-5)
    np.testing.assert_allclose(end.velocity[0], 0, atol=1e-5)


def test_the_plan_does_not_know_what_the_joystick_does_later():
    first, later = (0.2, 0.15, 0.0, True), (4.0, 0.05, -0.2, True)
    plain, changed = (plan_walk(pressed(*c), GAIT, 8.0, PATTERN_OMEGA) for c in ((first,), (first, later)))
    for one, two in zip(plain, changed, strict=True):
        if one.start < 4.0:
            np.testing.assert_array_equal(one.points, two.points)
            assert one.landing == two.landing
    assert plain[-1].landing != changed[-1].landing


def test_a_full_reversal_of_the_stick_moves_the_zero_moment_point_by_two_centimetres_for_one_step():
    phases = plan_walk(
        pressed((0.2, 0.15, 0.0, True), (3.0, -0.15, 0.2, True), (5.0, 0.15, -0.2, True)), GAIT, 8.0, PATTERN_OMEGA
    )
    moved = []
    for phase in phases:
        if phase.swing is not None:
            stance = phase.stance.foot("left" if phase.swing == "right" else "right")
            moved.append(np.linalg.norm(phase.points[1] - stance.point))
    largest = sorted(moved)[::-1]
    assert largest[0] < 0.025
    assert largest[2] < 1e-6


def test_motion_is_continuous_over_the_phases():
    phases = plan_walk(pressed((0.2, 0.15, 0.1, True), (4.0, 0.0, 0.0, False)), GAIT, 8.0, PATTERN_OMEGA)
    for phase in phases[1:]:
        around = pendulum_motion(phases, phase.start + np.array([-1e-9, 0.0]), PATTERN_OMEGA)
        for name in ("zmp", "dcm", "com", "velocity", "acceleration"):
            np.testing.assert_allclose(*getattr(around, name), atol=1e-6, err_msg=name)


def test_it_starts_again_after_a_stop():
    phases = plan_walk(
        pressed((0.2, 0.1, 0.0, True), (2.0, 0.0, 0.0, False), (7.0, 0.1, 0.0, True)), GAIT, 12.0, PATTERN_OMEGA
    )
    times = landings(phases)
    assert any(time < 5.0 for time in times)
    assert not any(5.0 < time < 7.0 for time in times)
    assert any(time > 8.0 for time in times)


def test_without_a_press_it_stands_over_the_origin():
    phases = plan_walk(pressed((0.0, 0.0, 0.0, False)), GAIT, 30.0, PATTERN_OMEGA)
    states = pendulum_motion(phases, np.linspace(0, 30, 100), PATTERN_OMEGA)
    np.testing.assert_array_equal(states.com, 0.0)


def test_velocity_and_acceleration_of_a_sole_are_the_derivatives_of_its_position(reference):
    # Oracle: central differences.
    step = 1e-5
    t = np.arange(1.0005, 6.0, 0.013)  # no sample at a lift-off or landing, where the third derivative jumps
    before, here, after = (foot_motion(reference.phases, t + k * step, "left", 0.04) for k in (-1, 0, 1))
    np.testing.assert_allclose((after.position - before.position) / (2 * step), here.velocity, atol=1e-8)
    np.testing.assert_allclose((after.velocity - before.velocity) / (2 * step), here.acceleration, atol=1e-6)


def test_a_sole_on_the_ground_does_not_move(reference):
    for foot in (reference.left, reference.right):
        np.testing.assert_array_equal(foot.position[foot.contact, 2], 0.0)
        np.testing.assert_allclose(foot.velocity[foot.contact], 0.0, atol=1e-12)


def test_a_swinging_sole_rises_to_the_step_height(reference):
    assert abs(reference.left.position[:, 2].max() - reference.gait.step_height) < 1e-12


def test_one_foot_is_always_on_the_ground(reference):
    assert (reference.left.contact | reference.right.contact).all()


def test_a_sole_comes_down_where_the_plan_says(reference):
    last = reference.phases[-1].landing
    np.testing.assert_allclose(reference.left.position[-1], [last.left.x, last.left.y, 0, last.left.heading])
    np.testing.assert_allclose(reference.right.position[-1], [last.right.x, last.right.y, 0, last.right.heading])


WAYS = (zmp.zmp_from_bodies, zmp.zmp_from_centroidal_momentum, zmp.zmp_from_contact_wrench)


@pytest.fixture(scope="module")
def humanoid():
    # Not the random sample, which is another robot in every process and leaves the ground in some.
    return pin.buildSampleModelHumanoid()


@pytest.fixture(scope="module")
def point_mass():
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
    model.appendBodyToJoint(joint, pin.Inertia(2.0, np.zeros(3), np.zeros((3, 3))), pin.SE3.Identity())
    return model


def standing_states(model, rng, samples=50):
    """Random states in which the ground still carries a good part of the weight."""
    limit = np.full(model.nq, np.pi)
    limit[:7] = 1.0
    pin.seed(7)
    data, states = model.createData(), []
    while len(states) < samples:
        q = pin.randomConfiguration(model, -limit, limit)
        v, a = rng.normal(size=model.nv), 0.5 * rng.normal(size=model.nv)
        pin.centerOfMass(model, data, q, v, a)
        if data.acom[0][2] > -5.0:
            states.append((q, v, a))
    return tuple(np.array(part) for part in zip(*states, strict=True))


@pytest.mark.parametrize("ground", [0.0, -0.7])
def test_body_sum_and_centroidal_momentum_and_contact_wrench_agree(humanoid, rng, ground):
    q, v, a = standing_states(humanoid, rng)
    bodies, centroidal, wrench = (way(humanoid, q, v, a, ground=ground) for way in WAYS)
    scale = max(1.0, np.abs(bodies).max())
    np.testing.assert_allclose(centroidal, bodies, rtol=0, atol=1e-12 * scale)
    np.testing.assert_allclose(wrench, bodies, rtol=0, atol=1e-12 * scale)


@pytest.mark.parametrize("way", WAYS)
def test_at_rest_it_is_the_projection_of_the_centre_of_mass(humanoid, rng, way):
    q, v, _ = standing_states(humanoid, rng, 5)
    data = humanoid.createData()
    com = np.array([pin.centerOfMass(humanoid, data, each)[:2] for each in q])
    np.testing.assert_allclose(way(humanoid, q, 0 * v, 0 * v), com, atol=1e-12)


@pytest.mark.parametrize("way", WAYS)
def test_a_body_that_starts_to_roll_moves_it_along_plus_y(way):
    # Closed form: a body that only spins about x with I alpha has y = + I alpha / (m g); Huang's printed sign is minus.
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
    model.appendBodyToJoint(joint, pin.Inertia(2.0, np.zeros(3), 0.3 * np.eye(3)), pin.SE3.Identity())
    q, v, a = np.zeros((1, 7)), np.zeros((1, 6)), np.zeros((1, 6))
    q[0, 6], a[0, 3] = 1.0, 4.0
    np.testing.assert_allclose(way(model, q, v, a), [[0.0, 0.3 * 4.0 / (2.0 * 9.81)]], atol=1e-14)


def test_point_masses_without_spin_are_off_by_more_than_ten_centimetres_in_fast_motion(humanoid, rng):
    # The published simplification: leave the angular momentum of each body about its centre out.
    q, v, a = standing_states(humanoid, rng)
    points = humanoid.copy()
    for joint in range(1, points.njoints):
        inertia = points.inertias[joint]
        points.inertias[joint] = pin.Inertia(inertia.mass, inertia.lever, np.zeros((3, 3)))
    exact, approximate = zmp.zmp_from_bodies(humanoid, q, v, a), zmp.zmp_from_bodies(points, q, v, a)
    assert np.abs(exact - approximate).max() > 0.1


@pytest.mark.parametrize("way", WAYS)
def test_free_fall_is_refused(point_mass, way):
    q, a = np.zeros((2, 7)), np.zeros((2, 6))
    q[:, 6], a[1, 2] = 1.0, -9.9
    with pytest.raises(ParameterError, match="does not press on the ground at sample 1"):
        way(point_mass, q, np.zeros((2, 6)), a)


def test_a_fixed_base_is_refused():
    model = pin.buildSampleModelManipulator()
    with pytest.raises(RobotError, match="needs a robot on a floating base"):
        zmp.zmp_from_bodies(model, np.zeros((1, 6)), np.zeros((1, 6)), np.zeros((1, 6)))


def test_gravity_that_is_not_vertical_is_refused(point_mass):
    tilted = point_mass.copy()
    tilted.gravity = pin.Motion(np.array([1.0, 0, -9.0, 0, 0, 0]))
    with pytest.raises(RobotError, match=r"needs gravity along -z, and it is \(1, 0, -9\)"):
        zmp.zmp_from_contact_wrench(tilted, np.zeros((1, 7)), np.zeros((1, 6)), np.zeros((1, 6)))
