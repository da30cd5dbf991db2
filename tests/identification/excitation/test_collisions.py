from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from identification.excitation.collisions import Collisions, collisions_of, distances
from phantom_dyn import load_robot
from phantom_dyn.errors import ParameterError


def ball_distance(q: np.ndarray) -> np.ndarray:
    """Closed form: the far ball of three links of 0.5 m in a plane, less both radii."""
    angles = np.cumsum(q, axis=1)
    end = -0.5 * np.stack([np.sin(angles).sum(axis=1), np.cos(angles).sum(axis=1)])
    return np.linalg.norm(end, axis=0) - 0.2


def test_the_distance_of_balls_is_that_of_their_centres_less_their_radii(chain_of_balls, rng):
    collisions = collisions_of(chain_of_balls)
    q = rng.uniform(-2.5, 2.5, (50, 3))
    found, slope = distances(chain_of_balls.model, collisions, q, slopes=False)
    assert collisions.names == ("base_0 and c_0",)
    assert slope is None
    np.testing.assert_allclose(found[:, 0], ball_distance(q), atol=1e-6)


def test_the_slope_of_a_small_distance_is_that_of_the_closed_form(chain_of_balls, rng):
    collisions = collisions_of(chain_of_balls, clearance=10.0)
    q, h = rng.uniform(-2.5, 2.5, (50, 3)), 1e-6
    slope = distances(chain_of_balls.model, collisions, q, slopes=True)[1]
    assert slope is not None
    for joint in range(3):
        step = h * np.eye(3)[joint]
        expected = (ball_distance(q + step) - ball_distance(q - step)) / (2 * h)
        np.testing.assert_allclose(slope[:, 0, joint], expected, atol=1e-6)


def test_neighbours_are_no_pair(chain_of_balls):
    # The base has a joint to link a, which has no shape; base and c are two joints apart.
    pairs = collisions_of(chain_of_balls).shapes.collisionPairs
    assert [(pair.first, pair.second) for pair in pairs] == [(0, 1)]


def test_a_robot_without_shapes_has_a_note(planar):
    collisions = collisions_of(planar)
    assert collisions.names == ()
    assert collisions.notes == ("planar2 has no collision shapes: collisions are not looked at.",)


def test_shapes_whose_mesh_is_missing_have_a_note(tmp_path, chain_of_balls):
    text = Path(chain_of_balls.source).read_text().replace('<sphere radius="0.1"/>', '<mesh filename="no.stl"/>')
    path = tmp_path / "missing.urdf"
    path.write_text(text)
    (note,) = collisions_of(load_robot(path)).notes
    assert note.startswith("Collisions are not looked at, as the shapes cannot be read (")


@pytest.mark.parametrize("clearance", [-0.1, np.nan])
def test_a_clearance_that_is_none_is_refused(chain_of_balls, clearance):
    with pytest.raises(ParameterError, match=r"A clearance of \S+ m was given: give 0 or more"):
        Collisions(collisions_of(chain_of_balls).shapes, clearance)
