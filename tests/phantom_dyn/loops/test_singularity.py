"""Distance of a chain from a singularity, against the transmission angle of a four-bar."""

from __future__ import annotations

import numpy as np

from phantom_dyn import load_robot
from phantom_dyn.loops.singularity import distance_from_singularity
from phantom_dyn.loops.solver import solve

POINT = "loops: [{kind: point, frame_a: coupler_pin, frame_b: rocker_pin, active: [crank]}]"


def test_the_distance_of_a_four_bar_is_that_of_its_transmission_angle(load):
    # Closed form: the law of cosines in the triangle of coupler, rocker and crank's pin to bearing.
    robot, q = load("fourbar.urdf", POINT), np.linspace(0.0, 6.0, 50)
    coupler, rocker = np.hypot(0.25, 0.05), 0.2
    apart = np.hypot(0.3 - 0.1 * np.cos(q), 0.1 * np.sin(q))
    cosine = (coupler**2 + rocker**2 - apart**2) / (2 * coupler * rocker)
    found = distance_from_singularity(solve(robot.model, robot.chain, q[:, None]).inverse)
    np.testing.assert_allclose(found, np.sqrt(1 - np.abs(cosine)), atol=1e-8)


def test_a_chain_whose_passive_joints_follow_by_expressions_is_never_singular():
    robot = load_robot("phantom_1_5")
    assert np.isinf(distance_from_singularity(robot.solutions.at(np.zeros((3, 3))).inverse)).all()


def test_the_distance_does_not_depend_on_the_size_of_the_linkage(load):
    # By hand: twenty times the lengths scale all columns alike.
    small, lengths = load("fourbar.urdf", POINT), ("0.1 0 0", "0.25 0 0.05", "0.3 0 0", "0 0 0.2")
    scaled = (" ".join(f"{20 * float(x):g}" for x in text.split()) for text in lengths)
    sizes = [
        (f'<origin xyz="{old}"/>\n    <parent', f'<origin xyz="{new}"/>\n    <parent')
        for old, new in zip(lengths, scaled, strict=True)
    ]
    large, q = load("fourbar.urdf", POINT, *sizes), np.array([[1.0]])
    found, expected = (distance_from_singularity(solve(r.model, r.chain, q).inverse) for r in (large, small))
    np.testing.assert_allclose(found, expected, rtol=1e-6)
