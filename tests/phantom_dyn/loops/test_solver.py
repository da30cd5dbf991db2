"""Closed loops: expressions, singular postures, solver and its compiled form."""

import copy
import math
import pickle

import numpy as np
import pytest

from phantom_dyn._kernels import jit
from phantom_dyn._kernels.pseudo_inverse import pseudo_inverse
from phantom_dyn.errors import ChainError
from phantom_dyn.loops.solver import distance_from_singularity, drift, solve, tree_positions
from phantom_dyn.model.linear_loops import LinearExpression, linear_expression
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Robot

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
    found = tree_positions(robot.model, robot.chain, q, arrays=robot.arrays)[:, 2]
    np.testing.assert_allclose(found, rocker_of_crank(q[:, 0]), atol=1e-10)


def test_samples_in_any_order_keep_the_way_of_assembly(load, rng):
    robot = load("fourbar.urdf", POINT)
    q = rng.uniform(-20, 20, (40, 1))
    found = tree_positions(robot.model, robot.chain, q, arrays=robot.arrays)[:, 2]
    np.testing.assert_allclose(found, rocker_of_crank(q[:, 0]), atol=1e-10)


def test_the_slope_is_that_of_the_positions(load):
    # Finite differences.
    robot = load("fourbar.urdf", POINT)
    q, step = np.linspace(-3, 3, 20)[:, None], 1e-5
    sides = [tree_positions(robot.model, robot.chain, q + sign * step, arrays=robot.arrays) for sign in (1, -1)]
    slope = solve(robot.model, robot.chain, q, arrays=robot.arrays).G[:, :, 0]
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
    tree = tree_positions(robot.model, robot.chain, q, arrays=robot.arrays)
    places = {name: k for k, name in enumerate(list(robot.model.names)[1:])}
    for k in range(3):
        np.testing.assert_allclose(tree[:, places[f"b_{k}"]], tree[:, places[f"a_{k}"]], atol=1e-10)


@pytest.mark.parametrize("gap", [0.1, 1e-2, 1e-3, 1e-4])
def test_next_to_the_limit_of_the_linkage_the_elbow_stays_on_its_side(load, rng, gap):
    # Closed form: at the limits crank and coupler are in line, folded at one and stretched at the other.
    robot = load("fourbar.urdf", f"loops: [{{kind: point, {PINS}, active: [rocker], start: {{crank: 0.1}}}}]")
    folded, stretched = (
        np.arcsin(((np.hypot(0.25, 0.05) + sign * 0.1) ** 2 - 0.3**2 - 0.2**2) / (2 * 0.3 * 0.2)) for sign in (-1, 1)
    )
    inside = gap * rng.uniform(1, 4, 100)
    q = np.where(rng.random(100) < 0.5, folded + inside, stretched - inside)[:, None]
    elbow = tree_positions(robot.model, robot.chain, q, arrays=robot.arrays)[:, 1] - np.arctan2(0.05, 0.25)
    assert (np.sin(elbow) < 0).all()


def test_the_distance_that_is_left_is_that_of_the_closed_form(load):
    robot = load("fourbar.urdf", f"loops: [{{kind: point, {PINS}, active: [rocker], start: {{crank: 0.1}}}}]")
    pin = np.array([0.3 + 0.2 * np.sin(1.5), 0.2 * np.cos(1.5)])
    left = np.linalg.norm(pin) - 0.1 - np.hypot(0.25, 0.05)
    with pytest.raises(ChainError, match=f"stay {left:.3g} m apart"):
        tree_positions(robot.model, robot.chain, np.array([[1.5]]), arrays=robot.arrays)


def test_a_flat_parallelogram_is_refused_as_singular(load):
    robot = load("parallelogram.urdf", POINT)
    with pytest.raises(ChainError, match=r"\(coupler_pin to rocker_pin\) is singular at or before sample 1 \(residual"):
        tree_positions(robot.model, robot.chain, np.array([[1.0], [np.pi / 2]]), arrays=robot.arrays)


def test_no_samples_give_no_positions(load):
    robot = load("fourbar.urdf", POINT)
    assert tree_positions(robot.model, robot.chain, np.zeros((0, 1)), arrays=robot.arrays).shape == (0, 3)


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda chain: pickle.loads(pickle.dumps(chain))])
def test_a_copy_of_a_chain_solves_alike(load, copied):
    robot = load("fourbar.urdf", POINT)
    q = np.array([[0.7]])
    found = tree_positions(robot.model, copied(robot.chain), q, arrays=robot.arrays)
    np.testing.assert_array_equal(found, tree_positions(robot.model, robot.chain, q, arrays=robot.arrays))


CRANK = f"loops: [{{kind: point, {PINS}, active: [crank]}}]"

ROCKER = f"loops: [{{kind: point, {PINS}, active: [rocker], start: {{crank: 0.1}}}}]"

BRANCHES = "".join(f'<link name="{side}{k}"/>' for side in "ab" for k in range(3)) + "".join(
    f'<joint name="{side}_{k}" type="{kind}"><origin xyz="0.1 0 0.2" rpy="0.3 0 {k}"/>'
    f'<parent link="{"base" if k == 0 else side + str(k - 1)}"/><child link="{side}{k}"/><axis xyz="0 0.6 0.8"/>'
    '<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
    for side in "ab"
    for k, kind in enumerate(("revolute", "continuous", "prismatic"))
)

WELD = "loops: [{kind: frame, frame_a: a2, frame_b: b2, active: [a_0, a_1, a_2]}]"


@pytest.fixture
def robots(load) -> dict[str, Robot]:
    return {
        "point": load("fourbar.urdf", CRANK),
        "frame": load("fourbar.urdf", WELD, ("</robot>", BRANCHES + "</robot>")),
        "two loops": load(
            "fourbar.urdf",
            f"loops: [{{kind: point, {PINS}, active: [crank]}}, {WELD.split('[', 1)[1]}",
            ("</robot>", BRANCHES + "</robot>"),
        ),
    }


@pytest.mark.parametrize("name", ["point", "frame", "two loops"])
def test_the_drift_is_the_acceleration_at_constant_active_speeds(robots, name, rng):
    # Second differences of the positions of the tree.
    robot, step = robots[name], 1e-4
    q, speed = 0.1 * rng.normal(size=(5, robot.nv)), rng.normal(size=(5, robot.nv))
    before, at, after = (solve(robot.model, robot.chain, q + k * step * speed, arrays=robot.arrays) for k in (-1, 0, 1))
    v = np.einsum("nti,ni->nt", at.G, speed)
    expected = (after.x - 2 * at.x + before.x) / step**2
    found = drift(robot.model, robot.chain, at, v, arrays=robot.arrays)
    np.testing.assert_allclose(found, expected, atol=1e-5 * max(1.0, np.abs(expected).max()))


@pytest.mark.parametrize("q", [[[-0.2], [-0.1], [1.5]], [[1.5]], [[-0.2], [np.pi]]])
def test_a_loop_that_cannot_be_closed_is_refused_at_its_sample(load, q):
    robot = load("fourbar.urdf", ROCKER)
    said = rf"loops\[0\] \(coupler_pin to rocker_pin\) cannot be closed at sample {len(q) - 1}"
    with pytest.raises(ChainError, match=said):
        solve(robot.model, robot.chain, np.array(q), arrays=robot.arrays)


def test_a_position_that_is_not_finite_is_refused_with_its_place(robots):
    robot = robots["point"]
    with pytest.raises(ChainError, match="position of active joint number 0 is not finite at sample 1: give finite"):
        robot.configuration(np.array([[0.1], [np.nan]]))


def test_without_numba_the_steps_are_those_of_python(robots, monkeypatch):
    robot, q = robots["point"], np.linspace(0.0, 1.0, 5)[:, None]
    expected = robot.configuration(q)
    monkeypatch.setattr(jit, "njit", lambda: None)
    np.testing.assert_allclose(robot.configuration(q), expected, atol=1e-12)


@pytest.mark.parametrize("shape", [(3, 2), (6, 6), (4, 1)])
def test_the_pseudo_inverse_is_that_of_numpy(rng, shape):
    slope, found = rng.normal(size=shape), np.empty(shape[::-1])
    assert pseudo_inverse(slope, 1e-5, found)
    np.testing.assert_allclose(found, np.linalg.pinv(slope), atol=1e-12)


@pytest.mark.parametrize("slope", [np.ones((3, 2)), np.zeros((2, 1)), np.ones((1, 2)), np.full((2, 2), np.nan)])
def test_a_slope_that_does_not_determine_the_unknowns_has_no_inverse(slope):
    assert not pseudo_inverse(slope, 1e-5, np.empty(slope.shape[::-1]))


JOINTS = ("q2", "q5", "arm-1", "arm")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("q5 - q2", LinearExpression(0.0, {"q5": 1.0, "q2": -1.0})),
        ("pi/2 - q5", LinearExpression(math.pi / 2, {"q5": -1.0})),
        ("-(2*q2 + 3)/4", LinearExpression(-0.75, {"q2": -0.5})),
        ("+q2*1e-3", LinearExpression(0.0, {"q2": 1e-3})),
        ("q2 + q2", LinearExpression(0.0, {"q2": 2.0})),
        ("2*arm-1 - arm", LinearExpression(0.0, {"arm-1": 2.0, "arm": -1.0})),
        ("0.3", LinearExpression(0.3)),
    ],
)
def test_sums_of_numbers_and_multiples_of_joints_are_read(text, expected):
    assert linear_expression(text, JOINTS) == expected


def test_a_joint_called_pi_is_a_joint():
    assert linear_expression("2*pi", ("pi",)) == LinearExpression(0.0, {"pi": 2.0})


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("q2*q5", "it multiplies two joints"),
        ("1/q2", "it divides by a joint"),
        ("q2/(1 - 1)", "it divides by zero"),
        ("sin(q2)", "it is more than a sum"),
        ("q2**1", "it is more than a sum"),
        ("True*q2", "it is more than a sum"),
        ("__import__('os')", "it is more than a sum"),
        ("q7 - q2", "'q7' in it is none of q2, q5, arm-1, arm, nor pi"),
        ("q2 -", "it cannot be read"),
        ("", "it cannot be read"),
    ],
)
def test_anything_else_is_refused_with_its_reason(text, reason):
    with pytest.raises(ValueError, match=reason):
        linear_expression(text, JOINTS)


COUPLER = "loops: [{kind: point, frame_a: coupler_pin, frame_b: rocker_pin, active: [crank]}]"


def test_the_distance_of_a_four_bar_is_that_of_its_transmission_angle(load):
    # Closed form: the law of cosines in the triangle of coupler, rocker and crank's pin to bearing.
    robot, q = load("fourbar.urdf", COUPLER), np.linspace(0.0, 6.0, 50)
    coupler, rocker = np.hypot(0.25, 0.05), 0.2
    apart = np.hypot(0.3 - 0.1 * np.cos(q), 0.1 * np.sin(q))
    cosine = (coupler**2 + rocker**2 - apart**2) / (2 * coupler * rocker)
    found = distance_from_singularity(solve(robot.model, robot.chain, q[:, None], arrays=robot.arrays).inverse)
    np.testing.assert_allclose(found, np.sqrt(1 - np.abs(cosine)), atol=1e-8)


def test_a_chain_whose_passive_joints_follow_by_expressions_is_never_singular():
    robot = load_robot("phantom_1_5")
    assert np.isinf(distance_from_singularity(robot.solutions.at(np.zeros((3, 3))).inverse)).all()


def test_the_distance_does_not_depend_on_the_size_of_the_linkage(load):
    # By hand: twenty times the lengths scale all columns alike.
    small, lengths = load("fourbar.urdf", COUPLER), ("0.1 0 0", "0.25 0 0.05", "0.3 0 0", "0 0 0.2")
    scaled = (" ".join(f"{20 * float(x):g}" for x in text.split()) for text in lengths)
    sizes = [
        (f'<origin xyz="{old}"/>\n    <parent', f'<origin xyz="{new}"/>\n    <parent')
        for old, new in zip(lengths, scaled, strict=True)
    ]
    large, q = load("fourbar.urdf", COUPLER, *sizes), np.array([[1.0]])
    inverses = (solve(r.model, r.chain, q, arrays=r.arrays).inverse for r in (large, small))
    found, expected = map(distance_from_singularity, inverses)
    np.testing.assert_allclose(found, expected, rtol=1e-6)
