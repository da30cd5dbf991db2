"""Loops that compiled steps close, against the same steps in Python."""

from __future__ import annotations

import numpy as np
import pytest

from phantom_dyn._kernels import jit
from phantom_dyn._kernels.pseudo_inverse import pseudo_inverse
from phantom_dyn.errors import ChainError
from phantom_dyn.loops.solver import drift, solve
from phantom_dyn.model.robot import Robot

PINS = "frame_a: coupler_pin, frame_b: rocker_pin"
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
def test_positions_slopes_and_drift_are_those_of_python(robots, name, rng):
    robot = robots[name]
    q = np.cumsum(rng.uniform(-0.4, 0.4, (30, robot.nv)), axis=0) * 0.3
    fast, slow = (solve(robot.model, robot.chain, q, arrays=a) for a in (robot.arrays, None))
    np.testing.assert_allclose(fast.x, slow.x, atol=1e-12)
    np.testing.assert_allclose(fast.G, slow.G, atol=1e-11)
    v = np.einsum("nti,ni->nt", slow.G, rng.normal(size=q.shape))
    expected = drift(robot.model, robot.chain, slow, v)
    found = drift(robot.model, robot.chain, slow, v, arrays=robot.arrays)
    np.testing.assert_allclose(found, expected, atol=1e-11 * max(1.0, np.abs(expected).max()))


@pytest.mark.parametrize("q", [[[-0.2], [-0.1], [1.5]], [[1.5]], [[-0.2], [np.pi]]])
def test_a_loop_that_cannot_be_closed_is_refused_with_the_sentence_of_python(load, q):
    robot, said = load("fourbar.urdf", ROCKER), []
    for arrays in (robot.arrays, None):
        with pytest.raises(ChainError, match=r"loops\[0\] \(coupler_pin to rocker_pin\) cannot be closed") as caught:
            solve(robot.model, robot.chain, np.array(q), arrays=arrays)
        said.append(str(caught.value))
    assert said[0] == said[1]


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
