"""Shapes of MJCF files are where MuJoCo has them."""

from __future__ import annotations

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from phantom_dyn.shapes.mjcf_shapes import shapes_of_mjcf

TEXT = """<mujoco><compiler angle="radian"/><asset><mesh name="wedge" vertex="0 0 0 .1 0 0 0 .1 0 0 0 .2"/></asset>
<worldbody><geom size=".1" pos="1 1 1"/><body pos="0 0 .3" euler=".3 0 .2"><joint axis="0 1 0" ref=".4"/>
<geom type="box" size=".1 .2 .3" pos=".1 0 0" group="3"/><body pos="0 .1 .3"><joint axis="1 0 0" pos="0 0 .1"/>
<geom type="mesh" mesh="wedge" pos="0 0 .1" euler="0 1 0"/><geom type="ellipsoid" size=".1 .2 .3" contype="0"
conaffinity="0"/></body></body></worldbody></mujoco>"""


@pytest.mark.parametrize(("use", "groups"), [("visual", [0, 2, 3]), ("collision", [0, 1, 2])])
def test_shapes_are_where_mujoco_has_them(tmp_path, use, groups):
    path = tmp_path / "robot.xml"
    path.write_text(TEXT)
    model, shapes = shapes_of_mjcf(path, use)
    compiled = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(compiled)
    data.qpos[:] = q = np.array([0.7, -0.5])
    mujoco.mj_kinematics(compiled, data)
    own, places = model.createData(), pin.GeometryData(shapes)
    pin.updateGeometryPlacements(model, own, shapes, places, q)
    found = [np.array(place.translation) for place in places.oMg]
    np.testing.assert_allclose(found, data.geom_xpos[groups], atol=1e-9)
    turned = [place.rotation.ravel() for place in places.oMg]
    np.testing.assert_allclose(turned, data.geom_xmat[groups], atol=1e-9)
