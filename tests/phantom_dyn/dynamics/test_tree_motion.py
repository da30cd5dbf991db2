"""Closed chains: motion of the tree and dynamics of a four-bar linkage."""

from collections.abc import Callable

import numpy as np
import pytest

from phantom_dyn.dynamics.dynamics import (
    gravity_torque,
    inverse_dynamics,
    inverse_dynamics_derivatives,
    link_torque,
    mass_matrix,
    modelled_friction,
    rigid_body_regressor,
    rotor_torque,
    standard_parameters,
)
from phantom_dyn.dynamics.tree_motion import joint_velocity, tree_motion
from phantom_dyn.errors import ChainError, LogError, RobotError
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion
from places import ROBOTS

POINT = "{kind: point, frame_a: coupler_pin, frame_b: rocker_pin, active: [crank]}"

ROTORS = "joints: {crank: {rotor_inertia: 2e-3}, rocker: {rotor_inertia: 1e-3}}"


@pytest.fixture
def chain(tmp_path) -> Callable[[str, str], Robot]:
    """A robot of the tests with a loop, and rotors on the crank and on the passive rocker."""

    def load(name: str, loop: str) -> Robot:
        config = tmp_path / "chain.yaml"
        config.write_text(f"{ROTORS}\nloops: [{loop}]")
        return load_robot(ROBOTS / name, config=config)

    return load


@pytest.fixture
def fourbar(chain) -> Robot:
    return chain("fourbar.urdf", POINT)


def turning(samples: int = 40) -> Motion:
    """A four-bar's crank on its way round: samples one after the other."""
    t = np.linspace(0, 3, samples)
    return Motion(t, (2 * t + np.sin(3 * t))[:, None], (2 + 3 * np.cos(3 * t))[:, None], (-9 * np.sin(3 * t))[:, None])


def swinging(rng: np.random.Generator, nv: int = 1, samples: int = 20) -> Motion:
    v, a = rng.normal(size=(2, samples, nv))
    return Motion(np.arange(samples) * 0.01, rng.uniform(-1, 1, (samples, nv)), v, a)


def test_accelerations_of_the_tree_are_those_of_its_velocities(fourbar):
    # Finite differences along the motion q(t) = sin t.
    def moved(t: np.ndarray) -> Motion:
        return Motion(t, np.sin(t)[:, None], np.cos(t)[:, None], -np.sin(t)[:, None])

    t, step = np.linspace(0, 6, 30), 1e-5
    ahead, behind = tree_motion(fourbar, moved(t + step)), tree_motion(fourbar, moved(t - step))
    found = tree_motion(fourbar, moved(t))
    np.testing.assert_allclose(found.v, (ahead.q - behind.q) / (2 * step), atol=1e-8)
    np.testing.assert_allclose(found.a, (ahead.v - behind.v) / (2 * step), atol=1e-7)


@pytest.mark.parametrize(
    "quantity", [inverse_dynamics, link_torque, rotor_torque, modelled_friction, rigid_body_regressor]
)
def test_a_parallelogram_stated_by_expressions_and_by_points_is_the_same(chain, rng, quantity):
    linear = chain("parallelogram.urdf", "{kind: linear, active: [crank], passive: {coupler: -crank, rocker: crank}}")
    numeric = chain("parallelogram.urdf", POINT)
    m = swinging(rng)
    np.testing.assert_allclose(quantity(numeric, m), quantity(linear, m), atol=1e-10)


def test_a_chain_with_both_kinds_of_loops_is_the_same(chain, rng):
    both = chain("parallelogram.urdf", "{kind: linear, active: [crank], passive: {coupler: -crank}}, " + POINT)
    numeric = chain("parallelogram.urdf", POINT)
    m = swinging(rng)
    np.testing.assert_allclose(inverse_dynamics(both, m), inverse_dynamics(numeric, m), atol=1e-10)


@pytest.mark.parametrize("source", ["phantom_1_5", "cea_branch"])
def test_the_regressor_times_the_parameters_is_the_torque_of_the_links(source, rng):
    robot = load_robot(source)
    m = swinging(rng, robot.nv)
    torque = rigid_body_regressor(robot, m) @ standard_parameters(robot)
    np.testing.assert_allclose(torque, link_torque(robot, m), atol=1e-12)


def test_links_rotors_and_friction_are_the_whole_torque(fourbar):
    m = turning()
    parts = link_torque(fourbar, m) + rotor_torque(fourbar, m) + modelled_friction(fourbar, m)
    np.testing.assert_allclose(parts, inverse_dynamics(fourbar, m), atol=1e-12)


def test_friction_of_a_passive_joint_takes_its_power_from_the_active_one(fourbar):
    # Closed form: power that joint by joint is lost, crank 0.01 and 0.02, rocker 0.03 and 0.05.
    m = turning()
    rocker = joint_velocity(fourbar, m, "rocker")[0]
    lost = 0.01 * m.v[:, 0] ** 2 + 0.02 * abs(m.v[:, 0]) + 0.03 * rocker**2 + 0.05 * abs(rocker)
    np.testing.assert_allclose(modelled_friction(fourbar, m)[:, 0] * m.v[:, 0], lost, atol=1e-12)


@pytest.mark.parametrize("which", ["fourbar", "phantom_1_5"])
def test_the_derivatives_of_the_torque_are_its_slopes(which, fourbar, rng):
    # Finite differences of another step.
    robot = fourbar if which == "fourbar" else load_robot(which)
    m, step = swinging(rng, robot.nv, 5), 1e-4
    for found, name in zip(inverse_dynamics_derivatives(robot, m), ("q", "v"), strict=True):
        for j in range(robot.nv):
            sides = []
            for sign in (1, -1):
                moved = {key: np.array(getattr(m, key)) for key in "qva"}
                moved[name][:, j] += sign * step
                shifted = Motion(m.t, **moved)
                sides.append(link_torque(robot, shifted) + rotor_torque(robot, shifted))
            np.testing.assert_allclose(found[:, :, j], (sides[0] - sides[1]) / (2 * step), atol=2e-6)


def test_gravity_may_be_given(fourbar):
    # Superposition: the torque is linear in gravity, and upright gravity is the robot's.
    q = turning().q
    x, z = (gravity_torque(fourbar, q, np.array(g)) for g in ((2.0, 0.0, 0.0), (0.0, 0.0, -9.81)))
    np.testing.assert_allclose(gravity_torque(fourbar, q, np.array([2.0, 0.0, -9.81])), x + z, atol=1e-12)
    np.testing.assert_allclose(gravity_torque(fourbar, q), z, atol=1e-12)


def test_the_passive_joints_of_the_phantom_turn_at_opposite_speeds(rng):
    robot = load_robot("phantom_1_5")
    m = swinging(rng, 3)
    (elbow, to_elbow), (crank, to_crank) = (joint_velocity(robot, m, name) for name in ("elbow", "crank"))
    np.testing.assert_allclose(elbow, m.v[:, 2] - m.v[:, 1], atol=1e-15)
    np.testing.assert_array_equal(crank, -elbow)
    np.testing.assert_array_equal(to_crank, -to_elbow)


def test_a_plain_robot_is_its_own_tree(rng):
    robot = load_robot(ROBOTS / "planar2.urdf")
    m = swinging(rng, 2)
    tree = tree_motion(robot, m)
    assert (robot.chain, robot.passive_names, robot.tree_rows) == (None, (), (0, 1))
    np.testing.assert_array_equal(tree.G, np.broadcast_to(np.eye(2), (20, 2, 2)))


def test_an_active_joint_takes_its_own_torque(rng):
    robot = load_robot("phantom_1_5")
    m = swinging(rng, 3)
    v, share = joint_velocity(robot, m, "theta2")
    np.testing.assert_array_equal(v, m.v[:, 1])
    np.testing.assert_array_equal(share, np.broadcast_to([0.0, 1.0, 0.0], (20, 3)))


def test_the_same_positions_are_solved_once(fourbar):
    m = turning()
    slope = tree_motion(fourbar, m).G
    assert tree_motion(fourbar, Motion(m.t, m.q, 2 * m.v, m.a)).G is slope
    assert tree_motion(fourbar, Motion(m.t, m.q + 0.1, m.v, m.a)).G is not slope


def test_a_joint_that_does_not_exist_is_refused(fourbar):
    with pytest.raises(RobotError, match=r"fourbar has no joint 'rock': the joints are crank, coupler, rocker; did"):
        joint_velocity(fourbar, turning(), "rock")


def test_a_value_that_is_not_finite_is_refused_before_the_loops_are_closed(fourbar):
    m = Motion(np.zeros(1), np.array([[np.nan]]), np.zeros((1, 1)), np.zeros((1, 1)))
    with pytest.raises(LogError, match="q of joint number 0 is not finite at sample 0"):
        inverse_dynamics(fourbar, m)


def test_dynamics_out_of_reach_says_which_loop_and_sample(chain):
    robot = chain("fourbar.urdf", POINT.replace("[crank]", "[rocker], start: {crank: 0.1}"))
    with pytest.raises(ChainError, match=r"loops\[0\] .* cannot be closed at sample 0"):
        mass_matrix(robot, np.array([[1.5]]))


@pytest.fixture
def braced(tmp_path) -> Robot:
    """Driven at the crank; rotors on the crank and on the passive rocker."""
    config = tmp_path / "chain.yaml"
    config.write_text(
        "joints: {crank: {rotor_inertia: 2e-3}, rocker: {rotor_inertia: 1e-3}}\n"
        "loops: [{kind: point, frame_a: coupler_pin, frame_b: rocker_pin, active: [crank]}]"
    )
    return load_robot(ROBOTS / "fourbar.urdf", config=config)


def loop_coordinates(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Inertia [kg m^2] and potential [J] of the four-bar about its crank, from circles that meet, without a tree.

    Angles turn about +y, from z to x; x and z as complex numbers ``x - 1j z``, so that they turn anticlockwise.
    """
    crank = np.exp(1j * q)
    pin_b, bearing, arm, rocker = 0.1 * crank, 0.3, 0.25 - 0.05j, -0.2j
    apart = bearing - pin_b
    along = (abs(apart) ** 2 + abs(arm) ** 2 - abs(rocker) ** 2) / (2 * abs(apart))
    point = pin_b + (along - 1j * np.sqrt(abs(arm) ** 2 - along**2)) * apart / abs(apart)
    # Rates per unit rate of the crank: point' = pin_b' + 1j w (point - pin_b) = 1j u (point - bearing).
    b, d, speed = point - pin_b, point - bearing, 1j * pin_b
    determinant = (b * d.conjugate()).imag
    w = -(speed / 1j * d.conjugate()).imag / determinant
    u = -(speed / 1j * b.conjugate()).imag / determinant
    center = (0.12 - 0.01j) / arm * b
    center_speed = speed + 1j * w * center
    inertia = (
        1e-3 + 2e-3 + 0.3 * 0.05**2 + 3e-3 * w**2 + 0.5 * abs(center_speed) ** 2 + (2e-3 + 1e-3 + 0.4 * 0.1**2) * u**2
    )
    height = -(0.3 * 0.05 * crank + 0.5 * (pin_b + center) + 0.4 * (bearing + d / 2)).imag
    return inertia, 9.81 * height


def test_a_four_bar_has_the_inertia_of_loop_coordinates(braced):
    q = turning().q
    np.testing.assert_allclose(mass_matrix(braced, q)[:, 0, 0], loop_coordinates(q[:, 0])[0], rtol=1e-9)


def test_a_four_bar_has_the_torque_of_loop_coordinates(braced):
    # Lagrange with one coordinate: I a + I' v^2 / 2 + V', slopes by central differences.
    m, step = turning(), 1e-5
    q, v, a = m.q[:, 0], m.v[:, 0], m.a[:, 0]
    (inertia_up, height_up), (inertia_down, height_down) = (loop_coordinates(q + s * step) for s in (1, -1))
    slope, force = (inertia_up - inertia_down) / (2 * step), (height_up - height_down) / (2 * step)
    expected = loop_coordinates(q)[0] * a + slope * v**2 / 2 + force
    torque = inverse_dynamics(braced, m) - modelled_friction(braced, m)
    np.testing.assert_allclose(torque[:, 0], expected, atol=1e-8)


def test_gravity_torque_is_the_slope_of_the_potential_of_loop_coordinates(braced):
    q, step = turning().q[:, 0], 1e-5
    slope = (loop_coordinates(q + step)[1] - loop_coordinates(q - step)[1]) / (2 * step)
    np.testing.assert_allclose(gravity_torque(braced, q[:, None])[:, 0], slope, atol=1e-8)


def test_samples_one_by_one_are_those_of_the_whole_motion(braced):
    m = turning()
    one_by_one = [
        inverse_dynamics(braced, Motion(m.t[k : k + 1], m.q[k : k + 1], m.v[k : k + 1], m.a[k : k + 1]))[0]
        for k in range(len(m.t))
    ]
    np.testing.assert_allclose(one_by_one, inverse_dynamics(braced, m), atol=1e-12)
