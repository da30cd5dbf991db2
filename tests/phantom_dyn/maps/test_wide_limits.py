"""Maps of a closed chain with wide joint limits: many postures do not close. Oracle: the posture itself."""

from __future__ import annotations

import numpy as np
import pytest

from phantom_dyn.maps import inverse
from phantom_dyn.maps.from_robot import map_model
from phantom_dyn.maps.inverse import cloud_of, nearest_branch
from phantom_dyn.maps.map_model import MapModel, tip_of
from phantom_dyn.model.loading import load_robot
from places import ROBOTS


@pytest.fixture(scope="module")
def model(tmp_path_factory) -> MapModel:
    """The five-bar with limits of more than a turn, and motors so far apart that its arms may point away."""
    path = tmp_path_factory.mktemp("wide") / "fivebar.urdf"
    text = (ROBOTS / "fivebar.urdf").read_text()
    wide = text.replace('lower="-3" upper="3"', 'lower="-3.3" upper="3.3"')
    wide = wide.replace('xyz="-0.15 0 0"', 'xyz="-0.22 0 0"').replace('xyz="0.15 0 0"', 'xyz="0.22 0 0"')
    assert wide.count("0.22 0 0") == 2
    assert wide.count("3.3") == 8
    path.write_text(wide)
    return map_model(load_robot(path, config=ROBOTS / "fivebar.yaml"))


@pytest.fixture(scope="module")
def cloud(model):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(inverse, "_NUMERIC_SAMPLES", 100)
        return cloud_of(model)


def test_only_postures_that_close_are_starts(model, cloud):
    assert 20 < len(cloud.q) < 100
    assert np.isfinite(cloud.tip).all()


def test_a_point_is_reached_by_the_posture_that_it_is_the_tip_of_and_one_out_of_reach_by_none(model, cloud):
    at = np.array([[0.15, -0.1], [-0.2, 0.05]])
    points = np.vstack([tip_of(model, at)[0], [[2.0, 0.0, 2.0]]])
    found = nearest_branch(model, points, cloud, axes=(0, 2))
    np.testing.assert_allclose(found[:2], at, atol=1e-6)
    assert np.isnan(found[2]).all()
