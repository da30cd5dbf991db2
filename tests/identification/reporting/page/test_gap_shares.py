from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from identification.diagnosis.result import JointGap
from identification.reporting.page.robot_scene import gap_shares, joint_colours, shares_of


def gaps(*ratios: float, floor: float = 0.1) -> tuple[JointGap, ...]:
    return tuple(JointGap(f"j{k}", "N m", ratio * floor, floor, floor, 10) for k, ratio in enumerate(ratios))


def test_shares_are_mean_squares_beyond_the_noise_floor():
    # Closed form: (2^2 - 1) : (3^2 - 1).
    assert gap_shares(gaps(2.0, 3.0, 1.0)) == pytest.approx([3 / 11, 8 / 11, 0])


def test_without_a_gap_no_joint_has_a_share():
    assert gap_shares(gaps(1.0, 0.8)).tolist() == [0, 0]


@pytest.mark.parametrize(("verdict", "shares"), [("explained", [3 / 11, 8 / 11]), ("no_gap", [0, 0])])
def test_what_a_model_that_fits_leaves_is_noise_and_no_share(made_up, verdict, shares):
    made = dataclasses.replace(made_up(), verdict=verdict, joints=gaps(2.0, 3.0))
    assert shares_of(made) == pytest.approx(shares)


@pytest.mark.parametrize("floor", [0.0, np.nan])
def test_a_joint_without_a_noise_floor_has_no_share(floor):
    joints = (*gaps(2.0), JointGap("x", "N m", 1.0, 1.0, floor, 10))
    assert gap_shares(joints).tolist() == [1, 0]


def test_the_largest_share_has_the_full_colour_and_none_is_grey():
    assert joint_colours(np.array([0.4, 0.0, 0.2]))[:2] == ["#e86600", "#d3dae3"]
