"""Grids. Oracle: the contract (both ends included) and numpy."""

from __future__ import annotations

import numpy as np
import pytest

from phantom_dyn.errors import ParameterError
from phantom_dyn.maps.grid import read_grid

JOINTS = ("theta1", "theta2", "theta3")


def test_both_ends_of_an_axis_are_included():
    np.testing.assert_array_equal(read_grid("x=-0.1:0.1:5", JOINTS).values[0], np.linspace(-0.1, 0.1, 5))


def test_points_run_fastest_along_the_last_axis():
    # Oracle: numpy's meshgrid.
    grid = read_grid("q.theta3=0:1:3, q.theta1=-1:1:2", JOINTS)
    expected = np.stack(np.meshgrid(*grid.values, indexing="ij"), axis=-1).reshape(-1, 2)
    np.testing.assert_array_equal(grid.points(0, grid.size), expected)


def test_blocks_of_points_follow_each_other():
    grid = read_grid("x=0:1:3,y=0:1:4,z=0:1:5", JOINTS)
    blocks = [grid.points(k, min(k + 7, grid.size)) for k in range(0, grid.size, 7)]
    np.testing.assert_array_equal(np.concatenate(blocks), grid.points(0, 60))


def test_one_point_makes_a_section():
    assert read_grid("x=0.1:0.1:1,y=0:1:4", JOINTS).shape == (1, 4)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x", r"has 'x', wanted NAME=START:STOP:COUNT such as x=-0\.1:0\.1:41"),
        ("x=0:1:3,", "has '', wanted NAME=START:STOP:COUNT"),
        ("w=0:1:3", "unknown axis 'w': the axes are x, y, z, q.theta1"),
        ("q.theta=0:1:3", r"unknown axis 'q\.theta'.*did you mean q\.theta"),
        ("x=0:1", "axis x of the grid is '0:1', wanted START:STOP:COUNT"),
        ("x=0:1:3:4", "axis x of the grid is '0:1:3:4', wanted"),
        ("x=a:1:3", "axis x of the grid is 'a:1:3', wanted"),
        ("x=0:1:2.5", r"axis x of the grid is '0:1:2\.5', wanted"),
        ("x=nan:1:3", "axis x of the grid is 'nan:1:3', wanted"),
        ("x=0:inf:3", "axis x of the grid is '0:inf:3', wanted"),
        ("x=0:1e308:3", r"axis x of the grid is '0:1e308:3': give m or rad, up to 1e\+06"),
        ("x=0:1:1", "give START and STOP apart with at least 2 points, or both the same with 1 point"),
        ("x=0:0:5", "give START and STOP apart"),
        ("x=0:1:0", "give START and STOP apart"),
        ("x=0:1:-3", "give START and STOP apart"),
        ("x=0:1:90000000000", "axis x of the grid has 90000000000 points, wanted at most"),
        ("x=0:1:1000,y=0:1:1000,z=0:1:1000", "The grid has 1000000000 points, wanted at most 20000000: take larger"),
        ("x=0:1:3,x=0:1:3", "has the axis x twice: give it once"),
        ("x=0:1:3,q.theta1=0:1:3", r"mixes x, q\.theta1: give a grid over the tip"),
    ],
)
def test_a_grid_that_cannot_be_read_is_refused_in_a_sentence(text, message):
    with pytest.raises(ParameterError, match=message):
        read_grid(text, JOINTS)
