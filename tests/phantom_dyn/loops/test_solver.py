from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

from phantom_dyn.errors import ChainError
from phantom_dyn.loops.solver import solve, tree_positions

PINS = "frame_a: coupler_pin, frame_b: rocker_pin"
POINT = f"loops: [{{kind: point, {PINS}, active: [crank]}}]"


def rocker_of_crank(angle: np.ndarray) -> np.ndarray:
    """Closed form: the rocker's pin lies where circles about the crank's pin and the rocker's bearing meet."""
    pin = 0.1 * np.stack([np.cos(angle), -np.sin(angle)], axis=-1)
    to_bearing = np.array([0.3, 0.0]) - pin
    apart = np.linalg.norm(to_bearing, axis=-1)
    along = (apart**2 + 0.25**2 + 0.05**2 - 0.2**2) / (2 * apart)
    across = np.sqrt(0.25**2 + 0.05**2 - along**2)
    unit = to_bearing / apart[:, None]
    point = pin + along[:, None] * unit + across[:, None] * np.stack([-unit[:, 1], unit[:, 0]], axis=-1)
    return np.arctan2(point[:, 0] - 0.3, point[:, 1])


def test_a_four_bar_turns_as_the_closed_form_over_two_turns(load):
    robot = load("fourbar.urdf", POINT)
    q = np.linspace(0.0, 4 * np.pi, 300)[:, None]
    found = tree_positions(robot.model, robot.chain, q)[:, 2]
    np.testing.assert_allclose(found, rocker_of_crank(q[:, 0]), atol=1e-10)


def test_samples_in_any_order_keep_the_way_of_assembly(load, rng):
    robot = load("fourbar.urdf", POINT)
    q = rng.uniform(-20, 20, (40, 1))
    found = tree_positions(robot.model, robot.chain, q)[:, 2]
    np.testing.assert_allclose(found, rocker_of_crank(q[:, 0]), atol=1e-10)


def test_the_slope_is_that_of_the_positions(load):
    # Finite differences.
    robot = load("fourbar.urdf", POINT)
    q, step = np.linspace(-3, 3, 20)[:, None], 1e-5
    sides = [tree_positions(robot.model, robot.chain, q + sign * step) for sign in (1, -1)]
    slope = solve(robot.model, robot.chain, q).G[:, :, 0]
    np.testing.assert_allclose(slope, (sides[0] - sides[1]) / (2 * step), atol=1e-8)


def test_frames_that_coincide_keep_their_axes_together(load, rng):
    # Closed form: a branch that repeats another one joint by joint follows it exactly.
    links = "".join(f'<link name="{side}{k}"/>' for side in "ab" for k in range(3))
    joints = "".join(
        f'<joint name="{side}_{k}" type="revolute"><origin xyz="0.1 0 0.2" rpy="0.3 0 {k}"/>'
        f'<parent link="{"base" if k == 0 else side + str(k - 1)}"/><child link="{side}{k}"/><axis xyz="0 1 0"/>'
        '<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
        for side in "ab"
        for k in range(3)
    )
    config = "loops: [{kind: frame, frame_a: a2, frame_b: b2, active: [a_0, a_1, a_2]}]"
    robot = load("fourbar.urdf", config, ("</robot>", links + joints + "</robot>"))
    q = rng.uniform(-1, 1, (10, robot.nv))
    tree = tree_positions(robot.model, robot.chain, q)
    places = {name: k for k, name in enumerate(list(robot.model.names)[1:])}
    for k in range(3):
        np.testing.assert_allclose(tree[:, places[f"b_{k}"]], tree[:, places[f"a_{k}"]], atol=1e-10)


def test_a_position_out_of_reach_is_refused_with_loop_sample_and_distance(load):
    # Closed form: the rocker's pin reaches at most 0.1 + hypot(0.25, 0.05) m from the crank's bearing.
    robot = load("fourbar.urdf", f"loops: [{{kind: point, {PINS}, active: [rocker], start: {{crank: 0.1}}}}]")
    q = np.array([[-0.2], [-0.1], [1.5]])
    with pytest.raises(
        ChainError, match=r"loops\[0\] \(coupler_pin to rocker_pin\) cannot be closed at sample 2: .*apart"
    ):
        tree_positions(robot.model, robot.chain, q)


@pytest.mark.parametrize("gap", [0.1, 1e-2, 1e-3, 1e-4])
def test_next_to_the_limit_of_the_linkage_the_elbow_stays_on_its_side(load, rng, gap):
    # Closed form: at the limits crank and coupler are in line, folded at one and stretched at the other.
    robot = load("fourbar.urdf", f"loops: [{{kind: point, {PINS}, active: [rocker], start: {{crank: 0.1}}}}]")
    folded, stretched = (
        np.arcsin(((np.hypot(0.25, 0.05) + sign * 0.1) ** 2 - 0.3**2 - 0.2**2) / (2 * 0.3 * 0.2)) for sign in (-1, 1)
    )
    inside = gap * rng.uniform(1, 4, 100)
    q = np.where(rng.random(100) < 0.5, folded + inside, stretched - inside)[:, None]
    elbow = tree_positions(robot.model, robot.chain, q)[:, 1] - np.arctan2(0.05, 0.25)
    assert (np.sin(elbow) < 0).all()


def test_the_distance_that_is_left_is_that_of_the_closed_form(load):
    robot = load("fourbar.urdf", f"loops: [{{kind: point, {PINS}, active: [rocker], start: {{crank: 0.1}}}}]")
    pin = np.array([0.3 + 0.2 * np.sin(1.5), 0.2 * np.cos(1.5)])
    left = np.linalg.norm(pin) - 0.1 - np.hypot(0.25, 0.05)
    with pytest.raises(ChainError, match=f"stay {left:.3g} m apart"):
        tree_positions(robot.model, robot.chain, np.array([[1.5]]))


def test_a_flat_parallelogram_is_refused_as_singular(load):
    robot = load("parallelogram.urdf", POINT)
    with pytest.raises(ChainError, match=r"\(coupler_pin to rocker_pin\) is singular at or before sample 1 \(residual"):
        tree_positions(robot.model, robot.chain, np.array([[1.0], [np.pi / 2]]))


def test_no_samples_give_no_positions(load):
    robot = load("fourbar.urdf", POINT)
    assert tree_positions(robot.model, robot.chain, np.zeros((0, 1))).shape == (0, 3)


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda chain: pickle.loads(pickle.dumps(chain))])
def test_a_copy_of_a_chain_solves_alike(load, copied):
    robot = load("fourbar.urdf", POINT)
    q = np.array([[0.7]])
    found = tree_positions(robot.model, copied(robot.chain), q)
    np.testing.assert_array_equal(found, tree_positions(robot.model, robot.chain, q))
